"""Stages under cocotb, a file for each: its component and its cases, from the golden model."""
