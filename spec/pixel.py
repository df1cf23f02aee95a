"""The bytes of a pixel, from the numbers of `spec.raster`."""

from splatcore.spec.config import Config


def background_code(config: Config, colour):
    """Return a pixel's 8 bits if only the background is visible; of integers or hardware values.

    Rounded as in stage 3: the weight of T = 1, rounded to a pixel's colour, then to 8 bits.
    """
    product = config.weight + config.colour_fraction - config.sum_fraction
    coarser = config.sum_fraction - 8
    total = ((colour << config.weight) - colour + (1 << product - 1)) >> product
    return (total + (1 << coarser - 1)) >> coarser


def alpha_code(config: Config, rest):
    """Return the 8 bits of a pixel's alpha; of integers or hardware values.

    rest: T when the last splat has been blended, in units of 2^−transmittance
    T of a new pixel, `full` = 2^transmittance − 1, stands for 1. Alpha is 255 · (full − T) /
    2^transmittance, rounded to nearest, ties up: 0 if no splat was blended, 255 if T is 0, and at
    most 1/2 + 255/2^transmittance levels from 255 · (1 − T).
    """
    bits = config.transmittance
    taken = rest ^ ((1 << bits) - 1)
    return ((taken << 8) - taken + (1 << bits - 1)) >> bits
