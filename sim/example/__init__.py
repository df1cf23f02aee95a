"""A folder that stands alone: Verilog, and a frame rendered by it under cocotb.

May import: golden, model, sim.common, sim.eda, sim.machine, spec.
"""
