"""The microprograms of stages 0 and 1, from a chunk's header to a splat, a line for each step.

`spec.microprogram` says what a line may be. Lengths are in pixels: x and y are camera coordinates
times the focal length, and the rows of the view rotation that belong to them likewise. Rows v turn
grid steps into camera units, rows w units of 2^factor_exponent, in which L is. Offsets are in grid
steps (`spec.memory`).
"""

CHUNK = """
# camera coordinates of the chunk's origin, from its way off the camera in grid steps
origin_x0 = vx0 * away_x
origin_x1 = vx1 * away_y + origin_x0
origin_x = vx2 * away_z + origin_x1
origin_y0 = vy0 * away_x
origin_y1 = vy1 * away_y + origin_y0
origin_y = vy2 * away_z + origin_y1
origin_z0 = vz0 * away_x
origin_z1 = vz1 * away_y + origin_z0
origin_z = vz2 * away_z + origin_z1

# the same way in scene units, and how far a Gaussian of the chunk reaches sideways at z = 1
from_x = away_x * grid
from_y = away_y * grid
from_z = away_z * grid
margin_x = spread_x * chunk_reach
margin_y = spread_y * chunk_reach
"""

CULL = """
z0 = vz0 * offset_x + origin_z
z1 = vz1 * offset_y + z0
z = vz2 * offset_z + z1
"""

PLACE = """
x0 = vx0 * offset_x + origin_x
x1 = vx1 * offset_y + x0
x = vx2 * offset_z + x1
y0 = vy0 * offset_x + origin_y
y1 = vy1 * offset_y + y0
y = vy2 * offset_z + y1

# guard band: a point farther out than this cannot touch the image
bound_x = z * guard_x + margin_x
bound_y = z * guard_y + margin_y
"""

PERSPECTIVE = """
# perspective: x/z and y/z in pixels, limited for the Jacobian
z_inverse = reciprocal(z)
slope_x = x * z_inverse
slope_y = y * z_inverse
limited_x = clamp(slope_x, limit_x)
limited_y = clamp(slope_y, limit_y)
"""

SKIPPING = """
# J·W without its factor 1/z; J has two zeros, whose products are left out
jx0 = wx0 - limited_x * wz0
jx1 = wx1 - limited_x * wz1
jx2 = wx2 - limited_x * wz2
jy0 = wy0 - limited_y * wz0
jy1 = wy1 - limited_y * wz1
jy2 = wy2 - limited_y * wz2

# M = J·W·L with L lower triangular
mx0a = jx0 * l00
mx0b = jx1 * l10 + mx0a
mx0 = jx2 * l20 + mx0b
mx1a = jx1 * l11
mx1 = jx2 * l21 + mx1a
mx2 = jx2 * l22
my0a = jy0 * l00
my0b = jy1 * l10 + my0a
my0 = jy2 * l20 + my0b
my1a = jy1 * l11
my1 = jy2 * l21 + my1a
my2 = jy2 * l22
"""

MOMENTS = """
# covariance: M·Mᵀ / z² + blur
xx0 = mx0 * mx0
xx1 = mx1 * mx1 + xx0
xx2 = mx2 * mx2 + xx1
xy0 = mx0 * my0
xy1 = mx1 * my1 + xy0
xy2 = mx2 * my2 + xy1
yy0 = my0 * my0
yy1 = my1 * my1 + yy0
yy2 = my2 * my2 + yy1
scale = z_inverse * z_inverse
xx = xx2 * scale + blur
xy = xy2 * scale
yy = yy2 * scale + blur
"""

DENSE = """
# J·W without its factor 1/z, zeros of J included
jx0a = one * wx0
jx0b = zero * wy0 + jx0a
jx0 = jx0b - limited_x * wz0
jx1a = one * wx1
jx1b = zero * wy1 + jx1a
jx1 = jx1b - limited_x * wz1
jx2a = one * wx2
jx2b = zero * wy2 + jx2a
jx2 = jx2b - limited_x * wz2
jy0a = one * wy0
jy0b = zero * wx0 + jy0a
jy0 = jy0b - limited_y * wz0
jy1a = one * wy1
jy1b = zero * wx1 + jy1a
jy1 = jy1b - limited_y * wz1
jy2a = one * wy2
jy2b = zero * wx2 + jy2a
jy2 = jy2b - limited_y * wz2

# M = J·W·L, zeros of L included
mx0a = jx0 * l00
mx0b = jx1 * l10 + mx0a
mx0 = jx2 * l20 + mx0b
mx1a = jx0 * zero
mx1b = jx1 * l11 + mx1a
mx1 = jx2 * l21 + mx1b
mx2a = jx0 * zero
mx2b = jx1 * zero + mx2a
mx2 = jx2 * l22 + mx2b
my0a = jy0 * l00
my0b = jy1 * l10 + my0a
my0 = jy2 * l20 + my0b
my1a = jy0 * zero
my1b = jy1 * l11 + my1a
my1 = jy2 * l21 + my1b
my2a = jy0 * zero
my2b = jy1 * zero + my2a
my2 = jy2 * l22 + my2b

"""

TRANSPOSED = """
# the covariance's other equal element
yx0 = my0 * mx0
yx1 = my1 * mx1 + yx0
yx2 = my2 * mx2 + yx1
yx = yx2 * scale
"""

CONIC = """
# conic in factors: Q = (dx − shear·dy)² · across + dy² · along. The Schur complement of the
# covariance is at least the blur in exact arithmetic; taking the larger of both keeps needles
# positive definite whatever the rounding.
along = reciprocal(yy)
shear = xy * along
rest = xx - shear * xy
schur = maximum(rest, blur)
across = reciprocal(schur)

# extents: alpha ≥ 1/255 where Q ≤ reach
reach = attenuation * reach_slope + reach_full
width_squared = reach * xx
height_squared = reach * yy
width_root = root(width_squared)
height_root = root(height_squared)
half_width = width_squared * width_root
half_height = height_squared * height_root
"""

COLOUR = """
# direction from the camera in world axes, and its length
ray_x = offset_x * grid + from_x
ray_y = offset_y * grid + from_y
ray_z = offset_z * grid + from_z
length0 = ray_x * ray_x
length1 = ray_y * ray_y + length0
length2 = ray_z * ray_z + length1
length_inverse = root(length2)

# colour + G·direction
red0 = g_red_x * ray_x
red1 = g_red_y * ray_y + red0
red2 = g_red_z * ray_z + red1
red = red2 * length_inverse + colour_red
green0 = g_green_x * ray_x
green1 = g_green_y * ray_y + green0
green2 = g_green_z * ray_z + green1
green = green2 * length_inverse + colour_green
blue0 = g_blue_x * ray_x
blue1 = g_blue_y * ray_y + blue0
blue2 = g_blue_z * ray_z + blue1
blue = blue2 * length_inverse + colour_blue
"""

CONSTANTS = (
    "vx0 vx1 vx2 vy0 vy1 vy2 vz0 vz1 vz2 grid spread_x spread_y guard_x guard_y "
    "zero one limit_x limit_y wx0 wx1 wx2 wy0 wy1 wy2 wz0 wz1 wz2 blur reach_slope reach_full"
).split()
"""Inputs that stay for a whole frame."""

SPLAT = "slope_x slope_y z across shear along half_width half_height attenuation"

TEXTS = {
    "chunk": (CHUNK, "origin_x origin_y origin_z from_x from_y from_z margin_x margin_y"),
    "cull": (CULL, "z"),
    "place": (PLACE, "x y bound_x bound_y"),
    "project": (PERSPECTIVE + SKIPPING + MOMENTS + CONIC, SPLAT),
    "project_sh": (PERSPECTIVE + SKIPPING + MOMENTS + CONIC + COLOUR, SPLAT + " red green blue"),
    "project_dense": (PERSPECTIVE + DENSE + MOMENTS + TRANSPOSED + CONIC, SPLAT),
    "project_sh_dense": (
        PERSPECTIVE + DENSE + MOMENTS + TRANSPOSED + CONIC + COLOUR,
        SPLAT + " red green blue",
    ),
}
"""Name → lines and outputs. Models without harmonics need no colour program; the dense programs
multiply by zeros as well and give the same bits: they show what leaving them out saves."""
