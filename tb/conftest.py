"""Order of the test files: the slowest first, so that all processes finish together; the file of
the small cell library, for `tb/eda` and `tb/study`."""

import pytest

LONGEST = (
    "stages/test_stages", "hdl/test_proofs", "test_demo", "test_walks", "app/test_example_command",
    "eda/test_verilog", "hdl/test_deal", "app/test_board_command",
    "eda/test_delivery", "machine/test_machine", "machine/test_wide_addresses", "hdl/test_sort",
    "machine/test_machine_driver", "hdl/test_raster", "hdl/test_points",
    "planted/test_mutate", "hdl/test_colour",
    "study/test_fit", "machine/test_machine_default", "app/test_command", "hdl/test_bin",
    "study/test_quality", "hdl/test_subsort", "hdl/test_model_reader", "machine/test_machine_steps",
    "sim/test_cycles", "hdl/test_float", "hdl/test_unary",
    "hdl/test_memory", "model/test_surround", "golden/test_pipeline",
    "eda/test_silicon", "eda/test_fpga", "hdl/test_pixels",
)  # fmt: skip
"""Test files that take 20 seconds or more, the slowest first."""


def pytest_collection_modifyitems(items: list) -> None:
    """Move the tests of these files to the front; xdist needs `--no-loadscope-reorder` for it."""
    order = {f"tb/{name}.py": place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(item.nodeid.split("::")[0], len(order)))


@pytest.fixture(scope="session")
def liberty_path(tmp_path_factory):
    from tb.helpers.liberty import small_library

    file = tmp_path_factory.mktemp("liberty") / "small.lib"
    file.write_text(small_library())
    return file
