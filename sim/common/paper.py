"""What the paper prints: Chang and Chang, "A 129FPS Full HD Real-Time Accelerator for 3D Gaussian
Splatting", IEEE TVCG. Gates, memories and power by stage are in `hdl.stages` and
`sim.power.estimate`.
"""

FPS = 129
"""Frames a second, the average of its scene set B, at 1920×1080 and 800 MHz."""

SIZE = (1920, 1080)

FPS_A, THROUGHPUT = 181, {"A": 378.9e6, "B": 267.5e6}
"""Frames a second of scene set A, and pixels a second of both sets."""

PIXELS_PER_JOULE = 1219e6

TILES = 8160
"""Of a frame, 16×16 pixels each."""

LIST, LIST_MAX = 1000, 5000
"""Gaussians of most tiles, and the most of a tile (its figure of tile density, bicycle)."""

BUFFERED, BUFFER_BYTES = 2000, 4096
"""Gaussians of a tile that a sub-sorter's own buffers are for, and bytes of one of both of them."""

SUB_SORTERS, SUB_SORTER_ENTRIES, CYCLES_AN_ENTRY = 4, 256, 2

PES, PES_DENSE, PES_BUSY = 6, 16, 0.516

CYCLES_A_POINT = 4
"""Of stage 0."""

OPERATIONS = {
    "with zeros": {"operations": 198, "add": 78, "multiply": 112, "divide": 7, "subtract": 1},
    "without zeros": {"operations": 94, "add": 46, "multiply": 42, "divide": 5, "subtract": 1},
}
"""Of stage 1 for a Gaussian."""

REDUCTION = 0.5253
"""Of those operations, as its text says."""

CULLED, CULLED_UNCOMPRESSED = 0.56, 0.60
"""Gaussians behind the near plane, of compressed and uncompressed models."""

TERMINATED, TERMINATED_UNCOMPRESSED = 0.243, 0.50
"""Gaussians that early termination leaves out."""

GAUSSIANS = 780_484
"""Of its model of Stump after pruning, the only number of Gaussians that it prints."""

FEATURE_BYTES = 32 * 1024
"""Of its feature memory."""

ABLATION = {
    "none": 20.4, "+ near-plane culling": 46.4, "+ zero skipping": 97.7,
    "+ early termination": 129.0,
}  # fmt: skip
"""Frames a second, step by step."""
