"""The group of commands `splatcore board`: the machine on a ULX3S, and frames by it."""

from splatcore.sim.cli.options import App, app

board = App(no_args_is_help=True, help="The machine on an FPGA board: its files, and frames of it.")
app.add_typer(board, name="board")
