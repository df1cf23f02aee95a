"""gsplat's conventions, as a `Convention` of ours.

Source: gsplat 1.5.3, `cuda/_torch_impl.py` and, for the two thresholds that its torch path leaves
to a CUDA kernel, `cuda/csrc/RasterizeToIndices3DGS.cu`. What agrees without a setting: the
Jacobian's margin of 1.3 (as long as cx = width/2 and cy = height/2), the blur of 0.3, the colour
offset, and the footprint: its boxes of 3.33 σ along x and y hold every pixel with alpha ≥ 1/255,
because √(2·ln 255) = 3.329.
"""

from splatcore.spec.convention import Convention

GSPLAT = Convention(
    near_plane=0.2,  # an option there, 0.01 if not given: `make` gives it this
    alpha_max=0.999,
    pixel_centre=0.5,
    principal_point_shift=0.0,
)
"""The rules of gsplat's CPU path. The background is black unless a stored scene names one."""
