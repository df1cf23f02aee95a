"""Compatibility of packed models and formats of pixels with machines."""

from dataclasses import replace

from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.memory import model_format
from splatcore.spec.packed import PackedModel


def check_renderable(config: Config, model: PackedModel):
    """Raise InputError, naming the reason, for a model that a machine cannot render."""
    format, preset = model.format, f"preset {config.name}"
    if model.antialiased and not config.compensates:
        why = f"the scene was trained with antialiasing, {preset} does not compensate opacities"
        advice = f"splatcore pack SCENE --no-antialiased --preset {config.name} -o MODEL"
        raise InputError(f"{model.name}: version {model.value('version')}: {why}; repack: {advice}")
    if format.sh_degree > config.sh_degree:
        why = f"has SH degree {format.sh_degree}, {preset} renders up to {config.sh_degree}"
    elif not format.codebooks and config.colours == "array":
        why = f"has colours in steps, {preset} renders compact models only"
    elif format.position != config.position:
        why = f"has positions of the kind '{format.position}', {preset} '{config.position}'"
    elif format.small and not config.small_models:
        why = f"has attributes in half a beat, {preset} reads whole beats only"
    elif format.levels and not config.levels:
        why = f"has levels of detail, {preset} renders models without"
    elif format.codebooks and replace(format, levels=False) != model_format(
        config, format.sh_degree, format.small
    ):
        why = f"has other codebook sizes than {preset}"
    else:
        return
    advice = f"splatcore pack SCENE --preset {config.name} -o MODEL"
    raise InputError(f"{model.name}: {why}; repack the scene: {advice}")


def check_format(config: Config, rgba: bool):
    """Raise InputError if pixels with alpha are requested from a machine without them."""
    if rgba and not config.rgba:
        raise InputError(f"preset {config.name}: rgba is false, so it renders no alpha (--rgba)")
