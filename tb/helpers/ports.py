"""Machines with memory ports and addresses of each width."""

from dataclasses import replace

from splatcore.spec.config import DEFAULT, PRESETS, Config

PORTS = {port: replace(DEFAULT, name=f"PORT{port}", port=port) for port in (128, 256)}


def other_port(config: Config) -> Config:
    """The same machine with the other port width."""
    return replace(config, name=f"{config.name}_OTHER", port=128 if config.port == 256 else 256)


def wide_addresses(config: Config) -> Config:
    """The same machine with 64-bit addresses."""
    return replace(config, name=f"{config.name}_WIDE", address_bits=64)


MAPS = (*PRESETS.values(), wide_addresses(DEFAULT))
"""Machines with register maps of all kinds."""
