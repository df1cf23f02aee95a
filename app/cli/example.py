"""The command `example`: a folder in which Verilog renders a frame, without Splatcore."""

from splatcore.app.cli.options import FolderOption, app
from splatcore.sim.common.output import console, progress_bar


@app.command("example")
def example_command(output: FolderOption):
    """Write a self-contained folder in which Verilog renders a frame.

    Preset TINY under cocotb, with a Makefile, requirements.txt, the scene and the expected picture.
    Start with README.md in the folder.
    """
    from splatcore.eda.example.example import write_example

    with progress_bar("writing the example"):
        paths = write_example(output)
    for path in paths:
        console.print(str(path), soft_wrap=True)
