"""`python -m splatcore` is the command `splatcore`."""

from splatcore.sim.cli.main import main

main()
