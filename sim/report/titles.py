"""The sections of a report."""

SECTIONS = {
    "scenes": (
        "Real scenes in RTL simulation",
        "The whole machine, from the packed model in memory to the pixels in memory, simulated "
        "cycle by cycle. Every picture is compared with the golden model's bit for bit, and with "
        "a float64 renderer's of the same packed model (machine) and of the scene as it is "
        "(scene), 8-bit pictures of all.",
    ),
    "quality": (
        "What bytes buy",
        "Packed models from few bytes a Gaussian to many, all at once as the machine renders them: "
        "its picture against the scene as it is, and cycles by the cycle model.",
    ),
    "budget": (
        "Where the error comes from",
        "The 8-bit picture against the scene as it is, all harmonics, in float64: what packing "
        "takes, part by part, and what the machine's numbers, its order and its output take.",
    ),
    "sweep": (
        "What each size and each number format buys",
        "One thing changed at a time, beside DEFAULT and PAPER (the paper's choices to the "
        "letter, as far as it states them). Cycles by the cycle model, pictures by the golden "
        "model; points simulated in RTL say so.",
    ),
    "paper": (
        "Beside the paper",
        "Chang and Chang, “A 129FPS Full HD Real-Time Accelerator for 3D Gaussian Splatting” "
        "(IEEE TVCG): its tables with ours beside them. Where its numbers agree with each other "
        "and where they cannot: docs/paper.md.",
    ),
    "published": (
        "Published accelerators",
        "Other machines for 3D Gaussian Splatting, by what their authors print.",
    ),
    "ablation": (
        "What each idea buys",
        "The same scenes with the machine's savings switched on one after the other.",
    ),
    "work": (
        "How much work a frame is",
        "Rates of culling and of early termination, how busy the processing elements are, and "
        "how many splats reach each tile.",
    ),
    "compression": (
        "Compression",
        "Pruning, distillation and quantisation with fine-tuning between, to models that the "
        "machine reads as they are: docs/compression.md.",
    ),
    "power": (
        "Power: an estimate",
        "First order: changes of nets in RTL simulation, times gates, times an energy for each. "
        "Nothing is laid out; a factor of two either way is within what this is good for.",
    ),
    "hard": (
        "Hard cases",
        "Small scenes on which renderers go wrong, each against the float64 reference on the same "
        "packed model.",
    ),
    "fpga": (
        "On an FPGA",
        "Preset FPGA as one design on a Lattice ECP5 (docs/fpga.md), and parts of machines that "
        "are made for 800 MHz in 28 nm, each on its own: they can be placed and routed.",
    ),
    "fit": (
        "Machines made to measure",
        "The smallest machines that reach a frame rate and a picture quality on given scenes, as "
        "users have asked for them.",
    ),
}
"""Title and introduction by name, in the order of the page."""
