"""A board: the machine in a LiteX system with SDRAM and a UART, and the host that drives it.

May import: spec, hdl, sim, eda, eda.deliver, eda.fpga.
"""
