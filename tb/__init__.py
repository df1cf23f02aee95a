"""cocotb benches and pytest tests, one file per word."""
