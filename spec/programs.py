"""The microprograms of stages 0 and 1, from a chunk's header to a splat, one line per step.

`spec.microprogram` has the syntax of a line. Lengths on the screen are in units of
2^`Config.screen_exponent` pixels: x and y are camera coordinates times the focal length in such
units, and so are their rows of the view rotation. Rows v turn scene units into camera coordinates,
rows w units of 2^factor_exponent, the unit of L. Rays are the vectors from the camera to the points
in world axes, exact on the model's grid (`spec.memory`) and rounded once.
"""

from splatcore.spec.colour import BASIS_CONSTANTS, BASIS_OF, polynomials
from splatcore.spec.compensation import COMPENSATION

CHUNK = """
# how far a Gaussian of the chunk reaches sideways at z = 1; reach_y: chunk_reach
margin_x = spread_x * chunk_reach
margin_y = spread_y * reach_y

# bounds of the points' camera coordinates. Each repeats the steps that its points will go through,
# from the corner of the chunk with the lowest or highest value. As rounding keeps the order of
# numbers, and the corners are CORNER_STEPS farther out, no point is beyond its chunk's bounds.
x_low = vx0 * x_least0 + vx1 * x_least1 + vx2 * x_least2
x_high = vx0 * x_most0 + vx1 * x_most1 + vx2 * x_most2
y_low = vy0 * y_least0 + vy1 * y_least1 + vy2 * y_least2
y_high = vy0 * y_most0 + vy1 * y_most1 + vy2 * y_most2
z_high = vz0 * z_most0 + vz1 * z_most1 + vz2 * z_most2
far_x = z_high * guard_x + margin_x
far_y = z_high * guard_y + margin_y
"""

LEVEL = """
# largest error with which a group of coarser chunks is drawn (`spec.levels`): the pixels of error
# at the nearest point of its sphere. These are the steps of z_high and far_x above, with other
# inputs, so that one PE runs both; inward: minus the sphere's radius
margin = lod * inward
middle = vz0 * ray_x + vz1 * ray_y + vz2 * ray_z
error_max = middle * lod + margin

# its centre's x, and how far sideways its Gaussians can reach, in the steps of x_low and far_y
aside = vx0 * ray_x + vx1 * ray_y + vx2 * ray_z
margin_side = surround * around
side = middle * wide + margin_side
"""

CULL = """
z = vz0 * ray_x + vz1 * ray_y + vz2 * ray_z
"""

INTERVAL = """
# the depth to which the chunk's farthest-reaching Gaussian would reach from here
farthest = z + chunk_reach
"""

PLACE = """
x = vx0 * ray_x + vx1 * ray_y + vx2 * ray_z
y = vy0 * ray_x + vy1 * ray_y + vy2 * ray_z

# guard band: a point farther out than this cannot touch the image
bound_x = z * guard_x + margin_x
bound_y = z * guard_y + margin_y
"""

PERSPECTIVE = """
# perspective: x/z and y/z, plus the principal point, and clamped for the Jacobian
z_inverse = reciprocal(z)
slope_x = x * z_inverse
slope_y = y * z_inverse
u = slope_x + principal_x
v = slope_y + principal_y
limited_x = clamp(slope_x, limit_x)
limited_y = clamp(slope_y, limit_y)
"""

SKIPPING = """
# J·W without its factor 1/z; products with J's two zeros are left out
jx0 = wx0 - limited_x * wz0
jx1 = wx1 - limited_x * wz1
jx2 = wx2 - limited_x * wz2
jy0 = wy0 - limited_y * wz0
jy1 = wy1 - limited_y * wz1
jy2 = wy2 - limited_y * wz2

# M = J·W·L with L lower triangular
mx0 = jx0 * l00 + jx1 * l10 + jx2 * l20
mx1 = jx1 * l11 + jx2 * l21
mx2 = jx2 * l22
my0 = jy0 * l00 + jy1 * l10 + jy2 * l20
my1 = jy1 * l11 + jy2 * l21
my2 = jy2 * l22
"""

MOMENTS = """
# covariance: M·Mᵀ / z² + blur
sum_xx = mx0 * mx0 + mx1 * mx1 + mx2 * mx2
sum_xy = mx0 * my0 + mx1 * my1 + mx2 * my2
sum_yy = my0 * my0 + my1 * my1 + my2 * my2
scale = z_inverse * z_inverse
xx = sum_xx * scale + blur
xy = sum_xy * scale
yy = sum_yy * scale + blur
"""

DENSE = """
# J·W without its factor 1/z, zeros of J included
jx0 = one * wx0 + zero * wy0 - limited_x * wz0
jx1 = one * wx1 + zero * wy1 - limited_x * wz1
jx2 = one * wx2 + zero * wy2 - limited_x * wz2
jy0 = one * wy0 + zero * wx0 - limited_y * wz0
jy1 = one * wy1 + zero * wx1 - limited_y * wz1
jy2 = one * wy2 + zero * wx2 - limited_y * wz2

# M = J·W·L, zeros of L included
mx0 = jx0 * l00 + jx1 * l10 + jx2 * l20
mx1 = jx0 * zero + jx1 * l11 + jx2 * l21
mx2 = jx0 * zero + jx1 * zero + jx2 * l22
my0 = jy0 * l00 + jy1 * l10 + jy2 * l20
my1 = jy0 * zero + jy1 * l11 + jy2 * l21
my2 = jy0 * zero + jy1 * zero + jy2 * l22

"""

TRANSPOSED = """
# the covariance's other equal element
sum_yx = my0 * mx0 + my1 * mx1 + my2 * mx2
yx = sum_yx * scale
"""

FACTORS = """
# conic in factors: Q = (dx − shear·dy)² · across + dy² · along. The Schur complement is vᵀΣv with
# v = (1, −shear), and Σ is at least the blur: in exact arithmetic it is at least blur·(1 + shear²).
# Taking the larger of both keeps needles positive definite and no thinner than the blur, whatever
# the rounding.
along = reciprocal(yy)
shear = xy * along
rest = xx - shear * xy
least0 = shear * blur
least = least0 * shear + blur
schur = maximum(rest, least)
across = reciprocal(schur)

# the same factors for E = −opacity − (dx − shear·dy)²·power_across − dy²·power_along
power_across = across * power
power_along = along * power
"""

EXTENTS = """
# extents: alpha ≥ 1/255 where Q ≤ reach
reach = attenuation * reach_slope + reach_full
width_squared = reach * xx
height_squared = reach * yy
width_rsqrt = rsqrt(width_squared)
height_rsqrt = rsqrt(height_squared)
half_width = width_squared * width_rsqrt
half_height = height_squared * height_rsqrt
"""

OUTLINE = """
# the outline Q = reach: dx = shear·dy ± slope·√(half_height² − dy²), rightmost at dy = lean and
# leftmost at −lean
ratio = along * schur
ratio_rsqrt = rsqrt(ratio)
slope = ratio * ratio_rsqrt
lean_width = shear * height_squared
lean = lean_width * width_rsqrt
"""

SQUARE = """
# the original renderer's square, of half side radius = 3·√λ with the covariance's larger eigenvalue
# λ = (xx + yy)/2 · (1 + spread), where spread = √((xx − yy)² + (2·xy)²) / (xx + yy). So all squared
# numbers are at most 1: in FP16 the squared differences of small splats would vanish, and of large
# splats overflow. The minimum spread is a rounding of 1; the root of 0 would be infinite.
trace = xx + yy
trace_inverse = reciprocal(trace)
difference = xx - yy
twice_xy = xy + xy
stretch = difference * trace_inverse
twist = twice_xy * trace_inverse
stretch_squared = stretch * stretch
either_squared = twist * twist + stretch_squared
spread_squared = maximum(either_squared, spread_least)
spread_rsqrt = rsqrt(spread_squared)
spread = spread_squared * spread_rsqrt
share = spread * square_reach + square_reach
radius_squared = trace * share
radius_rsqrt = rsqrt(radius_squared)
radius = radius_squared * radius_rsqrt
"""

SHAPE = {"exact": EXTENTS + OUTLINE, "3sigma": EXTENTS + SQUARE}
"""`Config.tile_test` → lines of the splat's shape: extents for the rasterizer in either case, and
the outline or the square by which binning finds its tiles."""

COLOUR = """
# length of the ray from the camera
length_squared = ray_x * ray_x + ray_y * ray_y + ray_z * ray_z
length_inverse = rsqrt(length_squared)

# colour + G·direction
slope_red = g_red_x * ray_x + g_red_y * ray_y + g_red_z * ray_z
red = slope_red * length_inverse + colour_red
slope_green = g_green_x * ray_x + g_green_y * ray_y + g_green_z * ray_z
green = slope_green * length_inverse + colour_green
slope_blue = g_blue_x * ray_x + g_blue_y * ray_y + g_blue_z * ray_z
blue = slope_blue * length_inverse + colour_blue
"""

CONSTANTS = (
    "vx0 vx1 vx2 vy0 vy1 vy2 vz0 vz1 vz2 spread_x spread_y guard_x guard_y principal_x principal_y "
    "zero one limit_x limit_y wx0 wx1 wx2 wy0 wy1 wy2 wz0 wz1 wz2 blur reach_slope reach_full "
    "power square_reach spread_least antialiased lod surround"
).split() + list(BASIS_CONSTANTS)
"""Inputs that are the same for all items."""

SQUARE_CONSTANTS = ("square_reach", "spread_least")
"""Constants that only machines with the 3σ square need."""

LEVEL_CONSTANTS = ("lod", "surround")
"""Constants that only machines with levels of detail need."""

CORNERS = {
    f"{axis}_{side}{k}": (f"v{axis}{k}", side)
    for axis, side in (("x", "least"), ("x", "most"), ("y", "least"), ("y", "most"), ("z", "most"))
    for k in range(3)
}
"""Field of the chunk program → the constant that multiplies it, and whether the product is the
"least" or the "most": the field is the chunk's end along world axis k for which it is."""

PROJECTED = {
    "exact": "u v z power_across shear power_along half_width half_height slope lean attenuation",
    "3sigma": "u v z power_across shear power_along half_width half_height radius attenuation",
}
"""`Config.tile_test` → outputs of the projection, except colours."""

COLOURS = ("colour_red", "colour_green", "colour_blue")
SLOPES = tuple(f"g_{channel}_{axis}" for channel in ("red", "green", "blue") for axis in "xyz")
"""Fields that come from the codebooks."""

CORNER_STEPS = 8
"""Codes by which a chunk's ends are moved apart: z, computed in finer numbers (`spec.depth`) and
rounded once more, may be above the chunk's bound by 4.4 · 2^-17 of the products' sizes together
(3 for the bound's roundings, 1 for z's last, ⅜ for finer ones), and a code is at least 2^-17.
"""

COVARIANCE_OF = {
    "": PERSPECTIVE + SKIPPING + MOMENTS,
    "_dense": PERSPECTIVE + DENSE + MOMENTS + TRANSPOSED,
}
"""Suffix of a program's name → its lines up to the covariance."""
COLOUR_OF = {"": ("", ""), "_flat": ("", " ".join(COLOURS)), "_sh": (COLOUR, "red green blue")}
"""Suffix → lines and outputs of colours: outside the array; in it without, and with, harmonics."""

PROJECTIONS = {"project": "exact", "square": "3sigma"}
"""First word of a projection's name → `Config.tile_test`."""

TEXTS = {
    "chunk": (CHUNK, "margin_x margin_y z_high x_low x_high y_low y_high far_x far_y"),
    "level": (LEVEL, "error_max aside side"),
    "cull": (CULL, "z ray_x ray_y ray_z"),
    "cull_interval": (CULL + INTERVAL, "z farthest ray_x ray_y ray_z"),
    "place": (PLACE, "x y bound_x bound_y"),
}
TEXTS |= {
    f"{name}{sh}{dense}{compensated}": (
        COVARIANCE_OF[dense] + FACTORS + opacity + SHAPE[test] + COLOUR_OF[sh][0],
        f"{PROJECTED[test]} {COLOUR_OF[sh][1]}",
    )
    for name, test in PROJECTIONS.items()
    for dense in COVARIANCE_OF
    for sh in COLOUR_OF
    for compensated, opacity in (("", ""), ("_antialiased", COMPENSATION))
}
TEXTS |= {f"basis{d}": (text, " ".join(polynomials(d))) for d, text in BASIS_OF.items()}
"""Name → lines and outputs, which may be inputs. Models without harmonics need no colour program;
the dense programs also multiply by zeros and return the same bits, to show the savings of leaving
them out. `square` is `project` for machines with the 3σ square. Machines that compensate opacities
run the `antialiased` programs, for all models."""
