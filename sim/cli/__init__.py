"""The command line: one file per command, or per few that are alike.

May import: spec, model, golden, hdl, sim.accuracy, sim.bench, sim.board, sim.common,
sim.compression, sim.cycles, sim.eda, sim.example, sim.fit, sim.machine, sim.packing, sim.power,
sim.report, sim.rtl, sim.soak, sim.view.
"""
