"""A self-contained example folder: Verilog, and one frame rendered by it under cocotb.

May import: spec, model, golden, sim, eda, eda.deliver.
"""
