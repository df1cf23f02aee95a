"""Titles and introductions of a report's sections."""

SECTIONS = {
    "scenes": (
        "Real scenes in RTL simulation",
        "The whole machine, from the packed model in memory to the pixels in memory, simulated "
        "cycle by cycle. Every picture is compared bit for bit with the golden model's, and as "
        "8-bit pictures with the float64 reference on the same packed model (machine) and on the "
        "scene as trained (scene).",
    ),
    "quality": (
        "Image quality against model size",
        "Each scene packed in several qualities, from few to many bytes per Gaussian: PSNR of the "
        "golden model's picture, which is the machine's bit for bit, and cycles by the cycle "
        "model.",
    ),
    "budget": (
        "Where the error comes from",
        "The error of the picture against the float64 reference on the scene as trained, with all "
        "harmonics: the part of each field of the packed model, and the parts of the machine's "
        "arithmetic, its depth order and its 8-bit output.",
    ),
    "sweep": (
        "Effect of each size and number format",
        "DEFAULT with one field changed at a time, compared with DEFAULT and with PAPER (the "
        "paper's choices, as far as it states them). Cycles by the cycle model, pictures by the "
        "golden model; points that were also simulated in RTL are in a table of their own.",
    ),
    "paper": (
        "Comparison with the paper",
        "Tables of Chang and Chang, “A 129FPS Full HD Real-Time Accelerator for 3D Gaussian "
        "Splatting” (IEEE TVCG), compared with ours. docs/paper.md shows where the paper's numbers "
        "agree with each other and where they do not.",
    ),
    "published": (
        "Published accelerators",
        "Other accelerators for 3D Gaussian Splatting, with figures from their authors.",
    ),
    "ablation": (
        "Gain of each idea",
        "The same scenes with the machine's savings switched on one after the other.",
    ),
    "compression": (
        "Compression",
        "Pruning, distillation and quantisation with fine-tuning in between, to packed models that "
        "the machine renders directly: docs/compression.md.",
    ),
    "power": (
        "Power: an estimate",
        "First order: changes of nets in RTL simulation × gates × energy per change, without a "
        "layout. It may be wrong by a factor of two in either direction.",
    ),
    "hard": (
        "Hard cases",
        "Small scenes that are difficult for renderers, each compared with the float64 reference "
        "on the same packed model.",
    ),
    "fpga": (
        "On an FPGA",
        "Preset FPGA as one design on a Lattice ECP5 (docs/fpga.md), and single parts of machines "
        "that are designed for 800 MHz in 28 nm, which can be placed and routed, too.",
    ),
    "fit": (
        "Custom machines",
        "The smallest machines, found by splatcore fit, that reach a frame rate and a PSNR on "
        "given scenes.",
    ),
}
"""Title and introduction by name, in the order of the page."""
