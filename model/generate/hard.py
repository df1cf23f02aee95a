"""The hard cases by name: small scenes that each sit on a corner where renderers go wrong."""

from collections.abc import Callable

from splatcore.model.generate import hard_geometry, hard_value
from splatcore.model.generate.hard_case import HardCase

HARD: dict[str, Callable[[int], HardCase]] = {
    "needles": hard_geometry.needles,
    "flakes": hard_geometry.flakes,
    "whole_screen": hard_geometry.whole_screen,
    "sub_pixel": hard_geometry.sub_pixel,
    "equal_depths": hard_geometry.equal_depths,
    "long_list": hard_geometry.long_list,
    "depth_range": hard_geometry.depth_range,
    "near_plane": hard_geometry.near_plane,
    "camera_inside": hard_geometry.camera_inside,
    "far_from_origin": hard_geometry.far_from_origin,
    "opacity_edge": hard_value.opacity_edge,
    "transmittance_edge": hard_value.transmittance_edge,
    "saturated_colours": hard_value.saturated_colours,
    "zero_scales": hard_value.zero_scales,
    "unnormalised_quaternions": hard_value.unnormalised_quaternions,
    "not_finite": hard_value.not_finite,
    "empty": hard_value.empty,
    "one": hard_geometry.one,
    "odd_size": hard_value.odd_size,
    "one_pixel": hard_value.one_pixel,
}
"""Name → function of a seed that returns the case; the same seed gives the same case."""

__all__ = ["HARD", "HardCase"]
