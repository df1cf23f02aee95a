"""Machines with memory ports of each width."""

from dataclasses import replace

from splatcore.spec.config import DEFAULT, Config

PORTS = {port: replace(DEFAULT, name=f"PORT{port}", port=port) for port in (128, 256)}


def other_port(config: Config) -> Config:
    """The same machine with a port of the other width."""
    return replace(config, name=f"{config.name}_OTHER", port=128 if config.port == 256 else 256)
