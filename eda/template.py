"""Generated files: filled from templates, and written into a folder."""

from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from splatcore.sim.common.output import write

ENVIRONMENT = Environment(
    loader=PackageLoader("splatcore.eda", "."),
    undefined=StrictUndefined,
    keep_trailing_newline=True,
    trim_blocks=True,
    lstrip_blocks=True,
)


def filled(template: str, **facts) -> str:
    """Fill `TEMPLATE.jinja`, a path in `eda`. facts: its variables."""
    return ENVIRONMENT.get_template(f"{template}.jinja").render(facts)


def write_texts(folder: Path, texts: dict[str, str]) -> list[Path]:
    """Write files, text by name, into a folder. Returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        write(folder / name, text.encode())
    return [folder / name for name in texts]
