"""`python -m splatcore` is the command `splatcore`."""

from splatcore.app.cli.main import main

main()
