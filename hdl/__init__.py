"""The Amaranth modules, one file per stage, each with its twin of the same name in `golden`."""
