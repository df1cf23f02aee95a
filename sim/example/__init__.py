"""A self-contained example folder: Verilog, and one frame rendered by it under cocotb.

May import: golden, model, sim.common, sim.eda, sim.machine, spec.
"""
