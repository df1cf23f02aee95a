"""Errors in the header of a packed model, as a machine should report them."""

import numpy as np

from splatcore.spec import memory
from splatcore.spec.config import Config
from splatcore.spec.record import Codes
from splatcore.spec.registers import ErrorCode


def error_in(config: Config, header: Codes, base: int = 0) -> ErrorCode:
    """Return the error in the header of a model at beat `base`, by plain integers."""

    def signed(codes) -> list[int]:
        return [(int(code) ^ 1 << 15) - (1 << 15) for code in np.atleast_1d(codes)]

    degree = int(header["sh_degree"])
    if header["magic"] != memory.MAGIC:
        return ErrorCode.MAGIC
    known = {3, 4} if config.compensates else {3}
    if header["version"] not in known | ({5} if config.levels else set()):
        return ErrorCode.VERSION
    if degree > config.sh_degree:
        return ErrorCode.DEGREE
    index = {name: [int(b) for b in header[name]] for name in ("colour_index", "sh_index")}
    codebooks = any(index["colour_index"])
    least, most = -15, [4, -3 if codebooks else 4, 4, 4]
    fits = header["position"] == (config.position == "absolute")
    fits &= header["small"] <= config.small_models
    fits &= -255 <= signed(header["position_exponent"])[0] <= 255
    fits &= all(least <= e <= m for e, m in zip(signed(header["exponent"]), most, strict=True))
    if codebooks and degree <= 1:
        bits = {"colour_index": config.colour_index, "sh_index": config.sh_index}
        for name, of in bits.items():
            fits &= index[name] == [*of[degree], *[0] * (4 - len(of[degree]))]
    else:
        fits &= not codebooks and not any(index["sh_index"]) and config.colours == "beside"
        fits &= not header["small"]
    free = header["version"] == 5 and config.compensates
    flags = free or header["antialiased"] == (header["version"] == 4)
    flags &= not config.levels or header["levels"] == (header["version"] == 5)
    if not fits or not (flags or unordered(header)):  # flags come after the first parts
        return ErrorCode.FORMAT
    return misplaced(config, header, base)


def unordered(header: Codes) -> bool:
    """Return whether parts overlap, by plain integers."""
    bytes_ = {name: 64 * int(header[name].reshape(-1)[0]) for name in memory.PLACED}
    count, stride = int(header["count"].reshape(-1)[0]), 64 if header["version"] == 5 else 32
    ordered = 64 + -(-count // 256) * stride <= bytes_["positions"] <= bytes_["attributes"]
    in_a_unit = 8 if header["small"] else 4
    return not ordered or bytes_["attributes"] + -(-count // in_a_unit) * 64 > bytes_["colours"]


def misplaced(config: Config, header: Codes, base: int) -> ErrorCode:
    """Return the error in the addresses of a model's parts, by plain integers."""
    bytes_ = {name: 64 * int(header[name].reshape(-1)[0]) for name in memory.PLACED}
    codebooks = header["colour_index"].any()
    entries = [0, 0]
    for k, part in enumerate(("colour_index", "sh_index")):
        entries[k] = sum(1 << int(bits) for bits in header[part].reshape(-1) if bits)
    if unordered(header):
        return ErrorCode.PARTS
    if bytes_["colours"] >= 1 << 32:
        return ErrorCode.RANGE
    if bytes_["colours"] + codebooks * (entries[0] * 8 + entries[1] * 16) > bytes_["end"]:
        return ErrorCode.PARTS
    return ErrorCode.NONE if base * 16 + bytes_["end"] <= 1 << 32 else ErrorCode.RANGE
