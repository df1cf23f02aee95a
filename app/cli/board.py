"""The group of commands `splatcore board`: the machine on a ULX3S."""

from splatcore.app.cli.options import App, app

board = App("board", no_args_is_help=True, help="Build the machine for an FPGA board and use it.")
app.add_group(board)
