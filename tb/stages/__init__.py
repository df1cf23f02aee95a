"""The table of stages (`table`), and their cases from the golden model."""
