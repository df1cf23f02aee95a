"""A component in simulation (Verilator, cocotb) or in a proof (SymbiYosys).

May import: sim.common.
"""
