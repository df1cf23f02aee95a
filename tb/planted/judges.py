"""Tests that judge the planted faults of each file in hdl/.

Sets of tests run one after the other until one catches the fault: quick tests of the part, the
testbench of its stage, small frames and injected faults of the whole machine, two frames of
`DEFAULT`, and machines with 64-bit addresses or with alpha if the file has logic for them.
"""

from tb.stages.points import PARTS

MACHINE = (
    "tb/machine/test_machine.py tb/machine/test_machine_steps.py tb/machine/test_faults.py "
    "-k 'not long_list and not full_size'"
)
DEFAULT = "tb/machine/test_machine_default.py -k garden"
WIDE = "tb/machine/test_wide_addresses.py"
ALPHA = "tb/hdl/test_raster.py tb/machine/test_alpha.py -k alpha"
STAGE = "tb/hdl/test_points.py -k 'stages and ({})'"
SMALL = "tb/hdl/test_points.py -k 'small or (stages and {})'"
BLENDED = "tb/hdl/test_raster.py -k 'tiles or groups or queues or stop'"
QUADS = "tb/hdl/test_raster.py -k 'quads or counters'"
FEATURES = (
    "tb/hdl/test_features.py tb/hdl/test_stream.py -k 'unrequested or (features and not found)'"
)
MASTER = (
    "tb/hdl/test_memory.py tb/hdl/test_proofs.py "
    "-k 'every_cycle or comes_first or patient or does_not_answer or (proved and axi_master)'"
)
HALVES = "tb/hdl/test_points.py tb/hdl/test_colour.py"

QUICK = {
    "": "",
    "arithmetic": "tb/hdl/test_float.py -k 'every_pair or every_triple or enable or conversions'",
    "arithmetic/convert": "tb/hdl/test_float.py",
    "arithmetic/minmax": "tb/hdl/test_float.py -k clamp",
    "arithmetic/unary": "tb/hdl/test_unary.py -k rtl",
    "arithmetic/unary_ends": "tb/hdl/test_unary.py -k rtl",
    "binning": "tb/hdl/test_bin.py -k '(hardware_equals and SHORT) or buffers'",
    "binning/binned": "tb/hdl/test_binned.py",
    "binning/list_writer": "tb/hdl/test_proofs.py -k 'list_writer and not fault'",
    "binning/row_end": "tb/hdl/test_bin.py -k row_end",
    "frame": "tb/hdl/test_proofs.py -k 'proved and frame'",
    "lib/counters": "tb/hdl/test_lib.py -k 'counted or counters'",
    "lib/credit": "tb/hdl/test_proofs.py tb/hdl/test_stream.py "
    "-k '(credit or invariants) and not fault'",
    "lib/latency": "tb/hdl/test_float.py -k one_side",
    "lib/holds": "tb/hdl/test_stream.py -k 'invariants or simulation or enough'",
    "lib/shift": "tb/hdl/test_float.py -k 'every_pair or every_triple or conversions'",
    "lib/stream": "tb/hdl/test_stream.py tb/hdl/test_proofs.py "
    "-k 'pace or wrong_bit or (proved and stream)'",
    "memory/axi": MASTER,
    "memory/bus": MASTER,
    "memory/fetch": "tb/hdl/test_model_reader.py -k 'models or positions'",
    "memory/share": "tb/hdl/test_groups.py",
    "memory/store": "tb/hdl/test_binned.py",
    "memory/turns": MASTER,
    "memory/words": "tb/hdl/test_memory.py -k 'bursts or neighbours or kept'",
    "memory/write_combiner": "tb/hdl/test_write_combiner.py",
    "points": STAGE.format("project"),
    "points/array": STAGE.format("cull or place or project"),
    "points/check": "tb/hdl/test_check.py",
    "points/codebook": "tb/hdl/test_colour.py -k from_the_array",
    "points/compensation": "tb/hdl/test_colour.py -k compensated",
    "points/colour": "tb/hdl/test_colour.py",
    "points/level": "tb/hdl/test_level.py tb/hdl/test_proofs.py -k 'level and not fault'",
    "points/load": "tb/hdl/test_model_reader.py",
    "points/look_up": "tb/hdl/test_colour.py -k from_the_array",
    "points/model_reader": "tb/hdl/test_model_reader.py",
    "points/position": STAGE.format("cull"),
    "points/preprocess": "",
    **{f"points/{name}": STAGE.format(name) for name in PARTS},
    "points/place": SMALL.format("place"),
    "points/slots": SMALL.format("project"),
    "raster": BLENDED,
    "raster/alpha": ALPHA,
    "raster/features": FEATURES,
    "raster/finished": "tb/hdl/test_finished.py",
    "raster/finished_quads": "tb/hdl/test_finished.py -k quads",
    "raster/groups": "tb/hdl/test_groups.py",
    "raster/list_reader": "",
    "raster/pixels": "tb/hdl/test_pixels.py -k 'not eight and not one'",
    "raster/prepare": "tb/hdl/test_raster.py -k 'prepare and DEFAULT'",
    "raster/quads": QUADS,
    "raster/recent": FEATURES,
    "raster/render": "",
    "raster/setup": "tb/hdl/test_raster.py -k 'tiles or other_end'",
    "raster/shared": QUADS,
    "registers": "tb/hdl/test_memory.py tb/hdl/test_proofs.py "
    "-k 'registers or (proved and (axi_lite or host))'",
    "sorting": "tb/hdl/test_sort.py -k 'tiny or TINY or counters or stop'",
    "sorting/cascade": "tb/hdl/test_subsort.py -k 'cascade or one_entry'",
    "sorting/sorter": "tb/hdl/test_proofs.py -k 'sorter and not fault'",
    "sorting/deal": "tb/hdl/test_deal.py -k 'not found'",
    "sorting/subsort": "tb/hdl/test_subsort.py tb/hdl/test_proofs.py "
    "-k 'trees or two_cycles or (proved and subsort)'",
}
"""Quick tests of a file or of a folder's files, as arguments of pytest; "" for none."""

BENCHES = {
    "": [],
    "arithmetic": ["project", "raster"],
    "binning": ["bin", "preprocess"],
    "binning/binned": ["preprocess"],
    "lib": ["sort", "project", "render"],
    "lib/stream": ["streams", "sort", "project", "render"],
    "memory": ["preprocess", "render"],
    "points": ["project"],
    "points/check": ["preprocess"],
    "points/chunk": ["chunk"],
    "points/level": ["chunk"],
    "points/cull": ["cull"],
    "points/depth": ["cull", "place"],
    "points/load": ["preprocess"],
    "points/model_reader": ["preprocess"],
    "points/place": ["place"],
    "points/points": ["preprocess"],
    "points/position": ["cull", "place"],
    "points/preprocess": ["preprocess"],
    "raster": ["rasterizer", "raster"],
    "raster/features": ["render"],
    "raster/recent": ["render"],
    "raster/finished": ["raster", "render"],
    "raster/groups": ["render"],
    "raster/list_reader": ["render"],
    "raster/mark": ["mark", "raster"],
    "raster/pixels": ["render"],
    "raster/prepare": ["prepare", "raster"],
    "raster/render": ["render"],
    "raster/setup": ["setup", "raster"],
    "sorting": ["sort", "spill"],
    "sorting/cascade": ["cascade", "sort"],
    "sorting/deal": ["spill"],
    "sorting/subsort": ["subsort"],
    "top": ["top"],
}
"""Testbenches in `tb/stages/` for the stages that contain a file or a folder's files."""

LAST = {
    "": MACHINE,
    "arithmetic": f"tb/hdl/test_float.py tb/hdl/test_unary.py {HALVES}",
    "points": HALVES,
    "sorting/runs": "tb/hdl/test_sort.py -k 'many_groups and three'",
    "sorting/subsort": "tb/hdl/test_subsort.py tb/hdl/test_sort.py",
}
"""Further tests of a file or of a folder's files, before those of whole machines."""

ADDRESSES = (
    "frame", "memory/axi", "memory/window", "points/preprocess", "raster/render", "registers", "top"
)  # fmt: skip
"""Files with logic for 64-bit addresses, judged last by a machine that has them."""

WITH_ALPHA = (
    "frame", "points/check", "raster/alpha", "raster/blend", "raster/finished", "raster/job",
    "raster/pixels", "raster/span_data", "raster/spans",
)  # fmt: skip
"""Files with logic for alpha, judged last by parts and a machine that have it."""


def judges(file: str) -> list[str]:
    """The sets of tests for a file such as `points/cull`, in order, as arguments of pytest."""
    benches = "".join(f" tb/stages/test_stages.py::test_stage[verilator-{name}]"
                      for name in found(BENCHES, file))  # fmt: skip
    order = [found(QUICK, file), benches.strip(), found(LAST, file), MACHINE, DEFAULT]
    order += [WIDE] * (file in ADDRESSES) + [ALPHA] * (file in WITH_ALPHA)
    return list(dict.fromkeys(filter(None, order)))


def found(table: dict, file: str):
    """A file's row of a table, else its folder's, else the one for all files."""
    return next(table[name] for name in (file, file.split("/")[0], "") if name in table)
