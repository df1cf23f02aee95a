"""The paper's published figures: Chang and Chang, "A 129FPS Full HD Real-Time Accelerator for 3D
Gaussian Splatting", IEEE TVCG. docs/paper.md checks them against each other."""

FPS = 129  # frames per second, the average of its scene set B, at 1920×1080 and 800 MHz

PIXELS_PER_JOULE = 1219e6

LOGIC = {
    "stage 0": (12_900, 2.14e-3),
    "stage 1": (71_600, 6.66e-3),
    "stage 2": (761_400, 102.88e-3),
    "stage 3": (88_900, 8.92e-3),
    "control": (208_900, 19.78e-3),
}
"""NAND2-equivalents and W by stage."""

GATES = {stage: gates for stage, (gates, _) in LOGIC.items()}

STAGE_OF = {"cull": "stage 0", "project": "stage 1", "sort": "stage 2", "raster": "stage 3"}
"""The paper's stage by module of Splatcore."""

GATES_ALL = 1_143_800  # NAND2-equivalents in all, as printed: 100 more than the sum

MEMORIES = {"sort": 56, "feature": 32, "view": 12, "process": 12, "codebook": 8}
"""KB by memory; `sort` is four key and four value buffers of 4 KB each, and 12 + 12 KB shared."""

AREA = {
    "stage 0": 4_887, "stage 1": 27_069, "stage 2": 287_820, "stage 3": 33_620, "control": 78_948,
}  # fmt: skip
"""um² of logic by stage."""

MEMORY_AREA = {
    "sort": 113_230, "feature": 56_759, "view": 22_001, "process": 22_001, "codebook": 15_266,
}  # fmt: skip
"""um² of memories."""

AREA_ALL = 661_601  # um² in all, as printed

UM2_PER_GATE = sum(AREA.values()) / sum(GATES.values())

UM2_PER_KB = sum(MEMORY_AREA.values()) / sum(MEMORIES.values())

CLOCK_HZ = 800e6

MEMORY_POWER = {
    "stage 1": ("codebook", 5.43e-3),
    "stage 2": ("sorting", 42.74e-3),
    "stage 3": ("feature", 15.15e-3),
    "control": ("view, process", 15.72e-3),
}
"""Memories and their power in W by stage. The paper does not assign the view and process
memories to a stage."""

POWER = 219.41e-3  # W in all, as in its text; the lines of its table add up to 0.01 mW more

PES, PES_DENSE, PES_BUSY = 6, 16, 0.516

OPERATIONS = {
    "with zeros": {"operations": 198, "multiply": 112, "add": 78, "divide": 7, "subtract": 1},
    "without zeros": {"operations": 94, "multiply": 42, "add": 46, "divide": 5, "subtract": 1},
}
"""Operations of stage 1 per Gaussian."""

ABLATION = {
    "none": 20.4,
    "+ near-plane culling": 46.4,
    "+ zero skipping": 97.7,
    "+ early termination": 129.0,
}
"""Frames per second, step by step."""
