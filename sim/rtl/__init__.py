"""Simulation (Verilator, cocotb) and formal proofs (SymbiYosys) of components.

May import: spec, sim.common.
"""
