"""What several tests share: inputs, machines, the command line. No tests."""
