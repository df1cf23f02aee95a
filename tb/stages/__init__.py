"""Stages under cocotb, one file per stage: its component, and its cases from the golden model."""
