"""Text files that are generated from templates beside this file."""

from jinja2 import Environment, PackageLoader, StrictUndefined

ENVIRONMENT = Environment(
    loader=PackageLoader("splatcore.sim.eda", "."),
    undefined=StrictUndefined,
    keep_trailing_newline=True,
    trim_blocks=True,
    lstrip_blocks=True,
)


def filled(name: str, **facts) -> str:
    """The template `NAME.jinja` with these facts."""
    return ENVIRONMENT.get_template(f"{name}.jinja").render(facts)
