"""Templates for files beside Verilog."""

from jinja2 import Environment, PackageLoader, StrictUndefined

ENVIRONMENT = Environment(
    loader=PackageLoader("splatcore.sim", "."),
    undefined=StrictUndefined,
    keep_trailing_newline=True,
    trim_blocks=True,
    lstrip_blocks=True,
)


def filled(name: str, room: str = "eda", **facts) -> str:
    """The template `NAME.jinja` of a folder of `sim` with these facts."""
    return ENVIRONMENT.get_template(f"{room}/{name}.jinja").render(facts)
