"""Templates of generated files."""

from jinja2 import Environment, PackageLoader, StrictUndefined

ENVIRONMENT = Environment(
    loader=PackageLoader("splatcore.eda", "."),
    undefined=StrictUndefined,
    keep_trailing_newline=True,
    trim_blocks=True,
    lstrip_blocks=True,
)


def filled(name: str, room: str = "deliver", **facts) -> str:
    """Fill the template `NAME.jinja` in a folder of `eda`.

    room: the folder
    facts: variables of the template
    """
    return ENVIRONMENT.get_template(f"{room}/{name}.jinja").render(facts)
