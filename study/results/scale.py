"""Results of `bench scale`: time and memory of commands by number of Gaussians."""

from splatcore.study.results.fields import item, part, result, table
from splatcore.study.results.frames import MILLION, failed, size

GIGA = 1e9

RATIO = "this checkout's over the other's; `null` if one of them failed"


def seconds(meaning: str, title: str):
    return item(meaning, "s", 1, title=title)


@result
class Cost:
    """A command's cost in one checkout."""

    cpu_seconds: float | None = seconds("of all its processes", "CPU")
    wall_seconds: float | None = seconds("from start to end", "wall")
    peak_bytes: int | None = item(
        "peak of its processes' anonymous memory, sampled; `null` without /proc", "GB", 2,
        title="peak", per=GIGA,
    )  # fmt: skip
    why: str = item("why the command failed; empty if it did not", title="failure")


@result
class ScaleRow:
    """A command on a generated scene."""

    gaussians: int = item("of the scene", "M", 3, title="Gaussians", per=MILLION)
    sh_degree: int = item("of the scene", digits=0, title="degree")
    run: str = item("the command", title="command", examples=("info",))
    cost: Cost = part("in this checkout")
    against: Cost = part("in the other checkout, with `--against`", maybe=True)
    cpu_ratio: float | None = item(RATIO, "×", 3, title="CPU ratio", maybe=True)
    peak_ratio: float | None = item(RATIO, "×", 3, title="peak ratio", maybe=True)


@result
class ScaleNeed:
    """Memory that a kind of work needs, fitted to the peaks of this checkout."""

    work: str = item("a key of `spec.need.NEEDS`", examples=("packing",))
    base: float = item("bytes of an empty scene", "MB", 0, per=MILLION)
    gaussian: float = item("bytes per Gaussian without harmonics", "bytes", 0)
    coefficient: float = item("bytes per Gaussian and coefficient of its harmonics", "bytes", 0)


@result
class Scale:
    """`scale.json`."""

    size: str = size("of the pictures")
    against: str | None = item("folder of the other checkout", kept=False)
    rows: list[ScaleRow] = table("one for each scene and command; `scale.csv` has them, too")
    failed: list = failed()
    needs: list[ScaleNeed] = table("what work needs: constants for `spec.need.NEEDS`", "needs")
