"""Properties that `tb.hdl` has proven."""
