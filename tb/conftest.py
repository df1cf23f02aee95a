"""The order of the tests' files: the longest first, so that all processes end at the same time."""

LONGEST = (
    "machine/test_machine.py",
    "sim/test_verilog.py",
)
"""Files that take more than half a minute, in the order of their times."""


def pytest_collection_modifyitems(items: list) -> None:
    """Move the tests of these files to the front; needs xdist's `--no-loadscope-reorder`."""
    order = {name: place for place, name in enumerate(LONGEST)}
    items.sort(
        key=lambda item: order.get(item.nodeid.split("::")[0].removeprefix("tb/"), len(order))
    )
