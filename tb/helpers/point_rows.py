"""Rows of the streams of stages 0 and 1 for a model and a camera, from the golden model.

Rows are packed records, uint8 [N, size], as in `sim.rtl.streams`.
"""

from dataclasses import dataclass

import numpy as np

from splatcore.golden.points import Points, project_points
from splatcore.hdl.points.state import ModelState, frame_state
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.frame import CAMERA, FrameConstants
from splatcore.spec.memory import ATTRIBUTE_BITS, CHUNK, CHUNK_HEADER, CODEBOOK_WORD, chunk_sizes
from splatcore.spec.number import Bits
from splatcore.spec.packed import PackedModel
from splatcore.spec.point import (
    EXPONENT,
    FETCH,
    NUMBER_BITS,
    WANTED,
    chunk_record,
    point_record,
    splat_record,
)
from splatcore.spec.record import Array, Record

BEAT = ATTRIBUTE_BITS // 8  # bytes of a memory beat

COORDINATES = {"culled": "z", "placed": "x y z"}  # of the points on these streams


@dataclass(frozen=True, eq=False)
class PointRows:
    """Rows of every stream, by name in `hdl.points.points`, and the registers.

    care: for streams with bits that do not matter, rows of ones where bits matter
    """

    config: Config
    points: Points
    streams: dict[str, np.ndarray]
    care: dict[str, np.ndarray]
    registers: dict[str, int]


def point_rows(config: Config, model: PackedModel, camera: Camera) -> PointRows:
    """Compute the rows of every stream by the golden model."""
    points = project_points(config, model, camera)
    kept = np.flatnonzero(points.read).astype(np.uint64)
    headers = model.image[model.layout.chunks :][: len(points.read) * model.format.header_stride]
    streams = {
        "headers": headers.reshape(-1, CHUNK_HEADER.size),
        "chunks": chunk_rows(config, model, points),
        "fetch": FETCH.pack({"number": kept, "count": counts(model)[kept].astype(np.uint64)}),
        "positions": position_rows(model, points),
        "wanted": wanted_rows(model, points.inside),
        "attributes": attribute_rows(model, points.inside),
        "write": codebook_rows(config, model),
        "splats": splat_rows(config, points),
    }  # fmt: skip
    tokens = token_rows(config, points)
    care = {name: care_of(config, COORDINATES[name], rows) for name, rows in tokens.items()}
    return PointRows(config, points, streams | tokens, care, registers(config, points.frame, model))


def counts(model: PackedModel) -> np.ndarray:
    """Number of Gaussians in each chunk."""
    return chunk_sizes(model.count)


def values(record: Record, source: dict[str, np.ndarray], index: np.ndarray) -> dict:
    """Codes of those fields of a record that `source` has values for."""
    fields = [(name, format) for name, format in record.fields if name in source]
    return {name: format.encode(source[name][index]) for name, format in fields}


def wanted_rows(model: PackedModel, index: np.ndarray) -> np.ndarray:
    """Requests for the attributes of Gaussians."""
    codes = dict(zip(("beat", "count"), model.attribute_bursts(index), strict=True))
    return WANTED.pack({name: code.astype(np.uint64) for name, code in codes.items()})


def attribute_rows(model: PackedModel, index: np.ndarray) -> np.ndarray:
    """Attribute beats of Gaussians, one after the other."""
    first, count = model.attribute_bursts(index)
    own = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return model.attribute_beats(np.repeat(first, count) + own)


def chunk_rows(config: Config, model: PackedModel, points: Points) -> np.ndarray:
    """Rows of the chunks that are kept."""
    record, kept = chunk_record(config), np.flatnonzero(points.read)
    headers = model.chunks
    first = kept * CHUNK if model.format.small else model.first_beats(kept * CHUNK)
    known = {"number": kept, "count": counts(model)[kept], "attributes": first}
    known |= {name: headers[name][kept] for name in ("octant_end", "shift", "harmonics", "step")}
    known = {name: codes.astype(np.uint64) for name, codes in known.items()}
    known["origin"] = CHUNK_HEADER["origin"].encode(headers["origin"][kept])
    fields = {}
    for name, part in record.fields:
        inner = {f: codes for f, codes in known.items() if f in dict(part.fields)}
        fields[name] = inner | values(part, points.chunks, kept)
    return record.pack(fields)


def position_rows(model: PackedModel, points: Points) -> np.ndarray:
    """Position beats of the kept chunks; each chunk begins with a new beat."""
    width, stride = model.format.position_record.width, model.format.position_stride
    parts = [np.zeros((0, BEAT), np.uint8)]
    for number in np.flatnonzero(points.read):
        beats = -(-int(counts(model)[number]) * width // ATTRIBUTE_BITS)
        start = model.layout.positions + number * stride
        part = np.zeros(beats * BEAT, np.uint8)
        found = model.image[start : start + len(part)]
        part[: len(found)] = found
        parts.append(part.reshape(-1, BEAT))
    return np.concatenate(parts)


def write_rows(config: Config, words: np.ndarray) -> np.ndarray:
    """The codebook memory's words [N, 16] with their addresses."""
    bits = (config.codebook // CODEBOOK_WORD - 1).bit_length()
    record = Record("write", {"address": Bits(bits), "word": Array(Bits(64), 2)})
    address = np.arange(len(words), dtype=np.uint64)
    return record.pack({"address": address, "word": words.view("<u8")})


def codebook_rows(config: Config, model: PackedModel) -> np.ndarray:
    """The words of a model's codebooks with their addresses."""
    words = model.image[model.layout.colours : model.layout.end]
    return write_rows(config, words.reshape(-1, CODEBOOK_WORD))


def token_rows(config: Config, points: Points) -> dict[str, np.ndarray]:
    """Points after stage 0 ("culled") and after the guard band ("placed"): all that are kept, and
    the last point of each chunk."""
    index, fields = points.points, dict(points.culled)
    last = np.append(index[1:] // CHUNK != index[:-1] // CHUNK, True)[: len(index)]
    front, inside = np.isin(index, points.front), np.isin(index, points.inside)
    placed = {name: np.zeros(len(index)) for name in "xy"}
    for axis in "xy":
        placed[axis][front] = points.placed[axis]
    rows = {}
    for name, kept in (("culled", front), ("placed", inside)):
        chosen = np.flatnonzero(kept | last)
        record = point_record(config, COORDINATES[name])
        codes = {
            "place": (index[chosen] % CHUNK).astype(np.uint64),
            "last": last[chosen].astype(np.uint64),
            "kept": kept[chosen].astype(np.uint64),
        }
        rows[name] = record.pack(codes | values(record, fields | placed, chosen))
    return rows


def care_of(config: Config, coordinates: str, rows: np.ndarray) -> np.ndarray:
    """Ones where bits of rows of points matter: not in numbers of points that are not kept."""
    record = point_record(config, coordinates)
    kept, found = record.unpack(rows)["kept"], {}
    for name, format in record.fields:
        ones = np.full(len(rows), (1 << format.width) - 1, np.uint64)
        found[name] = ones if name in ("place", "last", "kept") else np.where(kept, ones, 0)
    return record.pack(found)


def splat_rows(config: Config, points: Points) -> np.ndarray:
    """Rows of the splats."""
    return packed_splats(config, points.projected)


def packed_splats(config: Config, found: dict[str, np.ndarray]) -> np.ndarray:
    """Rows of splats with these values [N], colours by their names in any program."""
    record, count = splat_record(config), len(found["u"])
    colours = {name: found.get(f"colour_{name}") for name in ("red", "green", "blue")}
    return record.pack(values(record, colours | found, np.arange(count)))


def exponents(model: PackedModel) -> list[int]:
    """Codes of the exponents of all degrees."""
    return EXPONENT.encode(np.array(model.exponents, np.float64)).tolist()


def registers(config: Config, frame: FrameConstants, model: PackedModel) -> dict[str, int]:
    """Values of the ports `frame` and `model`."""
    format, shape = config.arithmetic, frame_state(config)
    names = shape["constants"].shape.members
    of_frame = shape.const({
        "camera": CAMERA.encode(frame.camera.astype(np.float64)).tolist(),
        "near_plane": int(format.encode(frame.near_plane)),
        "constants": {name: int(format.encode(frame.constants[name])) for name in names},
    })  # fmt: skip
    of_model = ModelState.const({
        "gaussians": model.count,
        "position_exponent": int(EXPONENT.encode(float(model.value("position_exponent")))),
        "sh": int(model.format.sh_degree > 0),
        "codebooks": int(model.format.codebooks),
        "small": int(model.format.small),
        "exponent": exponents(model),
    })  # fmt: skip
    # a reader that has asked for all headers
    of_levels = {"levels": int(model.format.levels), "turn": (1 << NUMBER_BITS) - 1}
    return {"frame": of_frame.as_bits(), "model": of_model.as_bits()} | of_levels
