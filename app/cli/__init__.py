"""The command line: one file per command, or per few that are alike.

May import: spec, model, golden, hdl, sim, eda, study, app.view.
"""
