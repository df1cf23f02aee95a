"""`python -m sim` is the command `splatcore`."""

from sim.command import main

main()
