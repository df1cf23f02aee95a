"""Verilog of stages: a file each, with a header that says what it is; and lint."""

import subprocess
from pathlib import Path

from amaranth.back import verilog
from amaranth.lib import wiring

from hdl.stages import STAGES
from sim.output import write
from sim.verilator import environment
from spec.config import Config

HEADER = """\
// Splatcore {name}, preset {preset}. Generated; the source is hdl/{name}.py.
// Apache-2.0.
//
{about}
"""

WAIVERS = Path(__file__).with_name("waivers.vlt")
"""What lint may say about generated Verilog, each with its reason."""


def stage_source(name: str, component: wiring.Component, config: Config) -> str:
    """Verilog text of a stage, its docstring on top."""
    about = "\n".join(f"// {line}".rstrip() for line in (component.__doc__ or "").splitlines())
    head = HEADER.format(name=name, preset=config.name, about=about)
    body = verilog.convert(component, name=f"splatcore_{name}", emit_src=False)
    return f"{head}\n{body}"


def write_stages(config: Config, folder: Path) -> list[Path]:
    """Write every stage of a machine into a folder, and the waivers; the paths of the files."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, make in STAGES.items():
        path = folder / f"splatcore_{name}.v"
        write(path, stage_source(name, make(config), config).encode())
        paths.append(path)
    write(folder / WAIVERS.name, WAIVERS.read_bytes())
    return [*paths, folder / WAIVERS.name]


def lint(path: Path, top: str) -> list[str]:
    """What `verilator --lint-only -Wall` says about a file beyond the waivers; none if clean."""
    done = subprocess.run(
        ["verilator", "--lint-only", "-Wall", "--top-module", top, WAIVERS, path],
        env=environment(), capture_output=True, text=True, check=False,
    )  # fmt: skip
    return [line for line in done.stderr.splitlines() if line.startswith("%")]
