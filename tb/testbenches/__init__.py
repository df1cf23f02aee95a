"""cocotb testbenches: they run inside a simulator that a test starts."""
