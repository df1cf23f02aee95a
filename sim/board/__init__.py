"""A board: the machine in a LiteX system with SDRAM and a UART, and the host that drives it.

May import: hdl, sim.common, sim.eda, sim.fit, sim.machine, spec.
"""
