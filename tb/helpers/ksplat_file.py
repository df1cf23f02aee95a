"""A writer of small KSPLAT files for tests, after the format's description."""

import struct

import numpy as np

HALF_STEPS = 32767  # 16-bit steps in half a bucket's side

BLOCK = 5.0  # side of a bucket

CAPACITY = 4  # Gaussians of a full bucket; the format's default is 256


def codes(count: int, degree: int, level: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Random stored values of Gaussians: position, scale, quaternion, colour, sh."""
    rng = np.random.default_rng(seed)
    width = 3 * ((degree + 1) ** 2 - 1)
    real = "<f4" if level == 0 else "<f2"
    sh = rng.integers(0, 256, (count, width), np.uint8)
    return {
        "position": (
            rng.integers(0, 1 << 16, (count, 3)).astype("<u2")
            if level
            else rng.normal(size=(count, 3)).astype("<f4")
        ),
        "scale": rng.uniform(0.01, 1, (count, 3)).astype(real),
        "quaternion": rng.normal(size=(count, 4)).astype(real),
        "colour": rng.integers(1, 256, (count, 4), np.uint8),
        "sh": sh if level == 2 else rng.normal(size=(count, width)).astype(real),
    }


def section(
    stored: dict[str, np.ndarray], degree: int, level: int, centres: np.ndarray, room: int = 0
) -> tuple[bytes, bytes]:
    """Header and content of a section whose buckets have `CAPACITY` Gaussians, the last ones 3 or
    fewer. centres: [buckets, 3]; room: unused Gaussians at the end"""
    count = len(stored["position"])
    rows = [v.view(np.uint8).reshape(count, v.shape[1] * v.itemsize) for v in stored.values()]
    rows = np.concatenate(rows, axis=1)
    full, lengths = split(count) if level else (0, [])
    buckets = full + len(lengths)
    head = struct.pack(
        "<IIIIfHxxIIIIH", count, count + room, CAPACITY, buckets, BLOCK, 12 if level else 0,
        HALF_STEPS, 0, full, len(lengths), degree,
    )  # fmt: skip
    meta = struct.pack(f"<{len(lengths)}I", *lengths) + centres[:buckets].astype("<f4").tobytes()
    body = rows.tobytes() + bytes(room * rows.shape[1])
    return head.ljust(1024, b"\0"), (meta if level else b"") + body


def split(count: int) -> tuple[int, list[int]]:
    """The number of full buckets, and the sizes of the others: 3, 2, 3, 2, … Gaussians."""
    full, lengths = count // (2 * CAPACITY), []
    rest = count - full * CAPACITY
    while rest:
        lengths.append(min(rest, 3 - len(lengths) % 2))
        rest -= lengths[-1]
    return full, lengths


def bucket_of(count: int) -> list[int]:
    """The bucket of each Gaussian of a section."""
    full, lengths = split(count)
    sizes = [CAPACITY] * full + lengths
    return [bucket for bucket, size in enumerate(sizes) for _ in range(size)]


def ksplat_bytes(
    level: int, sections: list[tuple[bytes, bytes]], count: int, low: float = -2, high: float = 3
) -> bytes:
    """A file of sections. low, high: range of harmonics of 8 bits"""
    number = len(sections)
    head = struct.pack("<4BIIIIHxx3fff", 0, 1, 0, 0, number, number, count, count, level, 0, 0, 0,
                       low, high)  # fmt: skip
    return (
        head.ljust(4096, b"\0")
        + b"".join(h for h, _ in sections)
        + b"".join(body for _, body in sections)
    )


def small_ksplat(level: int, degree: int, count: int = 21, seed: int = 0) -> bytes:
    """A file of one section of random Gaussians."""
    centres = np.random.default_rng(seed).normal(size=(count, 3)) * 9
    part = section(codes(count, degree, level, seed), degree, level, centres)
    return ksplat_bytes(level, [part], count)
