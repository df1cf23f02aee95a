"""Memory map of a board: the model, the picture, the work area and scratch memory."""

from splatcore.sim.machine.areas import Areas
from splatcore.spec.binning import PAGE_BITS
from splatcore.spec.camera import Camera
from splatcore.spec.config import Config
from splatcore.spec.error import InputError
from splatcore.spec.packed import PackedModel
from splatcore.spec.registers import address_values
from splatcore.spec.work import aligned, page_bytes, scratch_bytes, stride, work

MIB = 1 << 20


def place_in(config: Config, model: PackedModel, camera: Camera, at: int, size: int) -> Areas:
    """Place the areas for one frame at a time in a board's memory.

    at, size: address and bytes of the memory
    List pages get the rest of the memory. Raises InputError if not one page fits.
    """
    features = max(1, len(model))
    scratch = at + aligned(len(model.image))
    image = scratch + aligned(scratch_bytes(config))
    groups = image + aligned(stride(camera.width) * camera.height)
    left = at + size - groups - work(config, 0, features).size
    pages = min(left // page_bytes(config), (1 << PAGE_BITS) - 1)
    if pages < 1:
        need = (size - left) / MIB
        text = f"{len(model)} Gaussians at {camera.width}x{camera.height} take {need:.1f} MiB"
        raise InputError(f"{text} and lists; the board has {size / MIB:g} MiB")
    offsets = work(config, pages, features)
    values = {"WORK_AREA": 0, "LISTS_PAGES": pages, "FEATURES_MAX": features}
    for name, begin in (
        ("GROUPS", groups),
        ("LISTS", groups + offsets.lists),
        ("FEATURES", groups + offsets.features),
        ("SCRATCH", scratch),
    ):
        values |= address_values(config, name, begin)
    return Areas((at,), pages, features, (values,), (image,), (), groups + offsets.size)
