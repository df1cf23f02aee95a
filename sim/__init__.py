"""The command line: build, run, measure, report."""
