"""cocotb testbenches, which run inside a simulator; tests start them."""
