"""Results on machines: gates, memories, FPGA, power."""

from splatcore.study.results.fields import item, part, result, table
from splatcore.study.results.frames import THOUSAND, preset

FLIP_FLOPS = "of one of them"


def more(meaning: str):
    """An object that is not kept."""
    return item(meaning, kept=False, examples=({},))


@result
class Gates:
    """A part of the machine."""

    stage: str = item("its stage")
    count: int = item("how many there are", digits=0, none="")
    nand2: float = item(
        "NAND2-equivalents with flip-flops, without memories, mapped for area", "k NAND2", 1,
        per=THOUSAND, title="for area",
    )  # fmt: skip
    depth: float = item("gates on the longest path between registers, mapped for area", "gates", 0)
    speed_nand2: float = item(
        "the same, mapped for speed", "k NAND2", 1, per=THOUSAND, title="for speed", none=""
    )
    speed_depth: float = item("the same, mapped for speed", "gates", 0, title="depth", none="")
    flip_flops: int = item(FLIP_FLOPS)
    clock_gates: int = item("of its flip-flops, included in its size", kept=False, maybe=True)
    flip_flops_before: int = item("before optimisation", kept=False, maybe=True)
    memories: list = item("words and bits of each", kept=False)


@result
class Top:
    """The whole machine."""

    nand2: float = item("as for its parts")
    speed_nand2: float = item("as for its parts")
    paper_nand2: float | None = item("the paper's figure", kept=False)
    faults: list = item("latches, loops, several drivers or none", kept=False, maybe=True)
    flip_flops_before: dict = more(
        "before optimisation: of all `parts` and of the `whole`, which must be equal"
    )
    parts: dict[str, Gates] = table("by name", "", "part")


@result
class Synth:
    """`synth --stage top`."""

    preset: str = preset()
    stages: dict = item("parts asked for by name, as in `parts`", kept=False, maybe=True)
    top: Top = part("the whole machine")


@result
class Memory:
    """Memories of one size."""

    words: int = item("of each", digits=0)
    bits: int = item("of a word", digits=0)
    count: int = item("how many there are", digits=0)


@result
class Memories:
    """`memories`."""

    preset: str = preset()
    kilobytes: float = item("in all", "KB", 2, title="size")
    stages: dict[str, list[Memory]] = table("for each stage its memories", "", "stage")


@result
class Placed:
    """A part on an FPGA."""

    luts: int = item("without the registers around the part", digits=0, title="LUTs")
    flip_flops: int = item("the same", digits=0, title="flip-flops")
    multipliers: int = item("MULT18X18D", "MULT18X18D", 0)
    block_rams: int = item("DP16KD", "DP16KD", 0, title="block RAMs")
    fmax_mhz: float = item("the highest clock", "MHz", 1, title="Fmax")
    begin: str = item("register at which the slowest path begins", title="from")
    end: str = item("register at which it ends", title="to")


@result
class Routed(Placed):
    """A part, with the delay of its slowest path."""

    logic: float = item("ns of that path", "ns", 1)
    routing: float = item("ns of that path", "ns", 1)


@result
class Part(Placed):
    """A part alone."""

    logic: float = item("ns of that path", kept=False)
    routing: float = item("ns of that path", kept=False)


@result
class Fpga:
    """`fpga` without `--whole`."""

    preset: str = preset()
    device: str = item("`25k`, `45k` or `85k`", examples=("85k",))
    speed: str = item("its speed grade, `6`, `7` or `8`", examples=("6",))
    failed: dict = item("why a part is not placed, by name", examples=({},))
    parts: dict[str, Part] = table("by name", "", "part", examples=("array",))


@result
class WholeFpga:
    """`fpga --whole`."""

    preset: str = preset()
    device: str = item("`25k`, `45k` or `85k`", examples=("85k",))
    speed: str = item("its speed grade, `6`, `7` or `8`", examples=("8",))
    failed: dict = item("why a part is not placed, by name", examples=({},))
    parts: dict[str, Part] = table("the fastest, as `whole`", None, kept=False)
    seeds: list[Routed] = table("the machine placed from each seed")


@result
class Logic:
    """Energy of a stage's logic."""

    nand2: float = item("NAND2-equivalents", "k NAND2", 1, title="gates", none="", per=THOUSAND)
    flip_flops: float = item("of the stage")
    activity: float = item("changes of a net's bit in a cycle", "%", 2, none="", per=0.01)
    switching: float = item("J of a frame")
    clock: float = item("J of a frame")
    clock_always: float = item("J of a frame without clock gates", kept=False, maybe=True)
    leakage: float = item("W")


@result
class Storage:
    """Energy of a stage's memories."""

    kilobits: float = item("of the stage")
    reads: float = item("of a frame")
    writes: float = item("of a frame")
    access: float = item("J of a frame")
    leakage: float = item("W")


@result
class Power:
    """`power`: an ESTIMATE."""

    estimate: str = item("says that it is one", kept=False)
    preset: str = preset()
    scene: str = item("what was rendered", examples=("vase.ply",))
    camera: str = item("what was rendered", examples=("0",))
    size: list = item("width and height in pixels", examples=([64, 48],))
    antialiased: bool = item("as above", kept=False)
    antialiased_by: str = item("as above", kept=False)
    near: float = item("as above", kept=False)
    notes: list = item("as above", kept=False)
    liberty: dict = more(
        "with `--liberty`: `library`, `corner`, `voltage`, `process_nm`, and the `scale` of its "
        "energies to 28 nm"
    )
    fps: float = item("frames per second for which power is given")
    cycles: int = item("of a frame at full speed, with LPDDR4", kept=False)
    sampling: dict = more(
        "`window_cycles`, `one_in`: one window of this many was sampled, `simulated_cycles` of the "
        "run, `counted_cycles` of the frame"
    )
    power_w: float = item("of the chip without DRAM")
    leakage_w: float = item("of the chip without DRAM", kept=False)
    frame_j: float = item("of a frame, with its share of leakage", kept=False)
    dram_w: float = item("of DRAM")
    dram_frame_j: dict = more("of a frame by cause")
    pixels_per_j: float = item("pixels that a joule makes")
    pixels_per_j_with_dram: float = item("pixels that a joule makes", kept=False)
    traffic_bytes: dict = more("DRAM bytes of a frame by cause")
    constants: dict = more("`spec.energy.Energy`, and fJ and pJ that follow from it")
    paper: dict = item("its W by stage and memory, and the fJ of a NAND2 and cycle that they imply")
    stages: dict[str, Logic] = table("by name", "", "stage")
    parts: dict = more(
        "by name as `stages`, and `bits` of their nets, their `changes` in a frame, and bits that "
        "never changed (`still`)"
    )
    stage_memories: dict[str, Storage] = table("by name", "memories", "stage")
    memories: dict = more("by path as `stage_memories`")
    costs: list = item(
        "with `--toggles`: `name`, `part`, `bits` of the registers and memories that take the most "
        "power; `uses`, the share of cycles in which a register loads, or accesses per cycle; "
        "`power` in W", kept=False, maybe=True,
    )  # fmt: skip
