"""The group of commands `splatcore soak`."""

from splatcore.app.cli.options import App, app

soak = App(
    "soak", no_args_is_help=True, help="Random frames and faults in RTL, against the golden model."
)
app.add_group(soak)
