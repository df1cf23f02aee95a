"""The command `example`: a folder in which the Verilog renders a frame, without Splatcore."""

from splatcore.sim.cli.options import FolderOption, app
from splatcore.sim.common.output import console, progress_bar


@app.command("example")
def example_command(output: FolderOption):
    """Write a folder that stands alone: Verilog of TINY that renders a frame under cocotb.

    With a Makefile, requirements.txt, the scene, the expected picture, and README.md to begin with.
    """
    from splatcore.sim.example.example import write_example

    with progress_bar("writing the example"):
        paths = write_example(output)
    for path in paths:
        console.print(str(path), soft_wrap=True)
