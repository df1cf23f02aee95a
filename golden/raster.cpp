// Stage 3: splats prepared for setup, E around a tile, and blending a group's entries in order.
//
// Block by block, with a block's 16 pixels (and a tile's 16 blocks) as a vector. int32_t holds all
// their numbers within the limits of `spec.config.Config`.

#include "made.hpp"

#include <algorithm>
#include <cstring>
#include <vector>

using std::max;
using std::min;

constexpr int SIXTEEN = BLOCK * BLOCK;  // pixels of a block
static_assert(BLOCKS * BLOCKS == SIXTEEN);

// 16 numbers; a comparison's are −1 or 0.
typedef int32_t Vector __attribute__((vector_size(64)));
typedef uint32_t Unsigned __attribute__((vector_size(64)));
typedef int32_t Half __attribute__((vector_size(32)));
typedef int32_t Quarter __attribute__((vector_size(16)));

// Columns and rows of a tile's blocks, and of a block's pixels, from the centre.
constexpr int32_t A = STEPS[0], B = STEPS[1], C = STEPS[2], D = STEPS[3];
constexpr Vector X = {A, B, C, D, A, B, C, D, A, B, C, D, A, B, C, D};
constexpr Vector Y = {A, A, A, A, B, B, B, B, C, C, C, C, D, D, D, D};
constexpr Vector ONES = {1 << 0,  1 << 1,  1 << 2,  1 << 3, 1 << 4,  1 << 5,  1 << 6,  1 << 7, 1 << 8,
                         1 << 9, 1 << 10, 1 << 11, 1 << 12, 1 << 13, 1 << 14, 1 << 15};
const Vector XX = X * X, XY = X * Y, YY = Y * Y;

static Vector highest_of(Vector a, Vector b) { return a > b ? a : b; }

static int32_t sum_of(Vector v) {
    Half half[2];
    memcpy(half, &v, sizeof v);
    half[0] += half[1];
    Quarter four[2];
    memcpy(four, half, sizeof four);
    four[0] += four[1];
    return four[0][0] + four[0][1] + four[0][2] + four[0][3];
}

static int32_t highest_of(Vector v) {
    Half half[2];
    memcpy(half, &v, sizeof v);
    half[0] = half[0] > half[1] ? half[0] : half[1];
    Quarter four[2];
    memcpy(four, half, sizeof four);
    four[0] = four[0] > four[1] ? four[0] : four[1];
    return max(max(four[0][0], four[0][1]), max(four[0][2], four[0][3]));
}

struct Parts {
    bool negative;
    int64_t exponent, significand;
};

// Split the code of a float without subnormal numbers.
static Parts take_apart(int64_t code, int exponent, int fraction) {
    int64_t biased = code >> fraction & ((1 << exponent) - 1), one = 1 << fraction;
    int64_t significand = biased ? (code & (one - 1)) | one : 0;
    bool negative = code >> (exponent + fraction) & 1;
    return {negative, max<int64_t>(biased, 1) - ((1 << (exponent - 1)) - 1), significand};
}

// value · 2^−right, rounded down.
static int64_t shifted(int64_t value, int64_t right) {
    return right >= 0 ? value >> min<int64_t>(right, 62) : value << min<int64_t>(-right, 40);
}

static Prepared prepared(const Feature &f, const Machine &m) {
    Prepared p;
    p.u = f.u, p.v = f.v, p.scale = f.scale;
    auto normalise = [&](int64_t code, int64_t &factor, int64_t &power, int64_t &shift) {
        Parts parts = take_apart(code, FACTOR_EXPONENT, FACTOR_FRACTION);
        int64_t doublings = parts.exponent - FACTOR_SCALE;
        power = -((doublings + 1) >> 1);
        factor = parts.significand << ((doublings & 1) ^ 1);
        shift = power - f.scale;
    };
    normalise(f.across, p.across, p.k, p.across_shift);
    normalise(f.along, p.along, p.m, p.along_shift);
    Parts shear = take_apart(f.shear, SHEAR_EXPONENT, SHEAR_FRACTION);
    p.shear = shear.negative ? -shear.significand : shear.significand;
    p.lean_shift = m.lean_unit - shear.exponent;
    int64_t right = SHEAR_FRACTION - shear.exponent - SLOPE_FRACTION + p.k;
    p.slope = min(max(shifted(p.shear, right), -SLOPE_LIMIT), SLOPE_LIMIT - 1);
    int64_t mixed = p.across * p.slope >> m.mixed_shift;
    int64_t coarser = UNIT_FRACTION - m.fraction;
    p.cxx = shifted(p.across, coarser + 2 * p.k);
    p.cxy = shifted(mixed, MIXED_GUARD + p.k - 1);
    p.cyy = shifted(mixed * p.slope, SLOPE_FRACTION + MIXED_GUARD);
    p.cyy += shifted(p.along, coarser + 2 * p.m);
    p.opacity = f.opacity, p.red = f.red, p.green = f.green, p.blue = f.blue;
    return p;
}

// E around the tile at (column, row) of the image; whether the splat is near it.
static bool quadratic(const Prepared &p, int64_t column, int64_t row, int64_t fraction,
                      Quadratic &found) {
    int64_t dx = ((column * TILE_STEPS + HALF_TILE) >> p.scale) - p.u;
    int64_t dy = ((row * TILE_STEPS + HALF_TILE) >> p.scale) - p.v;
    int64_t lean = shifted(p.shear * dy, p.lean_shift), guard = fraction - POSITION_FRACTION;
    int64_t t = shifted((dx << guard) - lean, p.across_shift);
    int64_t d = shifted(dy << guard, p.along_shift);
    int64_t slope_t = p.across * t >> UNIT_FRACTION, slope_d = p.along * d >> UNIT_FRACTION;
    int64_t e = -(p.opacity << (fraction - OPACITY_FRACTION));
    e -= (slope_t * t >> fraction) + (slope_d * d >> fraction);
    int64_t gx = -shifted(slope_t, p.k - 1);
    int64_t gy = 2 * (p.slope * slope_t >> SLOPE_FRACTION) - shifted(slope_d, p.m - 1);
    auto fits = [&](int64_t value, int64_t integer) {
        int64_t limit = int64_t(1) << (integer + fraction);
        return -limit <= value && value < limit;
    };
    found = {e, gx, gy, p.cxx, p.cxy, p.cyy};
    return fits(lean, LEAN_INTEGER) && fits(t, LENGTH_INTEGER) && fits(d, LENGTH_INTEGER) &&
           fits(e, EXPONENT_INTEGER) && fits(gx, GRADIENT_INTEGER) && fits(gy, GRADIENT_INTEGER);
}

// E around (2x, 2y) from a tile's centre, the centre of a block.
static Quadratic around_block(const Quadratic &a, int64_t x, int64_t y) {
    return {a.e + 2 * (a.gx * x + a.gy * y) - 4 * (a.cxx * x * x - a.cxy * x * y + a.cyy * y * y),
            a.gx - 4 * a.cxx * x + 2 * a.cxy * y, a.gy - 4 * a.cyy * y + 2 * a.cxy * x,
            a.cxx, a.cxy, a.cyy};
}

// Bounds on twice the E of each block's pixels: E is concave, below its tangent plane.
static Vector twice_highest(const Quadratic &around) {
    int32_t e = around.e, gx = around.gx, gy = around.gy;
    int32_t cxx = around.cxx, cxy = around.cxy, cyy = around.cyy;
    Vector centre = e + 2 * (gx * X + gy * Y) - 4 * (cxx * XX - cxy * XY + cyy * YY);
    Vector slope_x = gx - 4 * cxx * X + 2 * cxy * Y, slope_y = gy - 4 * cyy * Y + 2 * cxy * X;
    return 2 * centre + 3 * (highest_of(slope_x, -slope_x) + highest_of(slope_y, -slope_y));
}

// A block's pixels: T, colours so far, and −1 until they end.
struct Pixels {
    Vector rest, sum[3], live;
};

// A tile: its blocks; their live pixels, levels, and twice the E from which on each is marked.
struct Tile {
    Pixels blocks[SIXTEEN];
    Vector live, level, bound;
    int64_t remaining;
};

struct Outcome {
    int visited, contributing, blended, ended;  // numbers of pixels
};

// E of a block's pixels, around its centre in half-pixel steps.
static Vector exponents(const Quadratic &around, const Machine &m) {
    const int32_t coarser = m.coarser, e = 4 * around.e >> coarser;
    const int32_t gx = 2 * around.gx >> coarser, gy = 2 * around.gy >> coarser;
    const int32_t cxx = around.cxx >> coarser, cxy = around.cxy >> coarser;
    const int32_t cyy = around.cyy >> coarser;
    return e + gx * X + gy * Y + cxy * XY - cxx * XX - cyy * YY;
}

// Blend a splat into a block.
static Outcome blend_block(const Quadratic &around, const int32_t *colour, Pixels &pixels,
                           const Machine &m, const int32_t *table) {
    const int32_t lowest = m.lowest, finer = m.finer, steps = m.steps, index = (1 << steps) - 1;
    const int32_t mantissa = m.mantissa, narrower = m.narrower;
    const int32_t dark = m.dark, least = m.taken, ends = m.rest_min, all = -m.takes_all;
    const int32_t product = m.product, half = 1 << (product - 1);
    Vector exponent = exponents(around, m);
    Vector visible = exponent >= lowest;
    exponent = visible ? exponent : lowest - Vector{};
    exponent = (exponent < 0 ? exponent : Vector{} - 1) >> finer;
    Vector halvings = -1 - (exponent >> steps), place = exponent & index, power;
    for (int k = 0; k < SIXTEEN; k++) power[k] = table[place[k]];
    Vector rest = pixels.rest;
    Vector taken = (Vector)((Unsigned)rest * (Unsigned)power >> (Unsigned)(mantissa + halvings));
    Vector reached = visible & pixels.live & ~((rest < dark) & (taken < least));
    Vector left = rest - taken, ended = reached & (left < ends), blended = reached & (all | ~ended);
    left &= ~ended;
    Vector weight = ((rest >> narrower) - (left >> narrower)) & blended;
    pixels.rest = blended ? left : rest;
    pixels.live &= ~ended;
    for (int c = 0; c < 3; c++) pixels.sum[c] += (weight * colour[c] + half) >> product;
    Vector counts = (visible & 1) + (reached & 1 << 8) + (blended & 1 << 16) + (ended & 1 << 24);
    int32_t total = sum_of(counts);
    return {total & 255, total >> 8 & 255, total >> 16 & 255, total >> 24 & 255};
}

// The arrays of a frame (`golden.raster`).
struct Frame {
    const Feature *features;
    const int64_t *start, *splat, *mask, *first;
    const Machine &machine;
    const int64_t *owners;
    const Level *levels;
    const int32_t *table;
    void *pixels;
    Work *work;
    Pairs *pairs;
    int64_t *blocks;
};

// Blend a splat into a tile; return the marked and visited blocks.
static int64_t blend_tile(const Quadratic &around, const int32_t *colour, Tile &tile,
                          const Frame &f, Work *work) {
    Vector marked = (twice_highest(around) >= tile.bound) & (tile.live > 0) & ONES;
    int64_t blocks = 0;
    for (int32_t left = sum_of(marked); left; left &= left - 1) {
        int k = __builtin_ctz(left);
        Quadratic own = around_block(around, X[k], Y[k]);
        Outcome found = blend_block(own, colour, tile.blocks[k], f.machine, f.table);
        Work &counts = work[f.owners[k]];
        counts.marked++;
        counts.visited += found.visited > 0;
        counts.contributing += found.contributing > 0;
        counts.contributions += found.blended;
        counts.ended += found.ended;
        blocks |= int64_t(1) << k | int64_t(found.visited > 0) << (SIXTEEN + k);
        tile.live[k] -= found.ended, tile.remaining -= found.ended;
        if (!found.contributing) continue;
        const Pixels &pixels = tile.blocks[k];
        for (int32_t most = highest_of(pixels.rest & pixels.live); most < f.levels[tile.level[k]].above;)
            tile.bound[k] = f.levels[++tile.level[k]].marked;
    }
    return blocks;
}

// Begin a tile of which `wide` × `high` pixels are in the image.
static void begin(Tile &tile, int64_t wide, int64_t high, const Machine &m, const Level *levels) {
    tile.remaining = 0;
    for (int block = 0; block < SIXTEEN; block++) {
        Pixels &pixels = tile.blocks[block];
        pixels.rest = int32_t(m.full) - Vector{};
        pixels.sum[0] = pixels.sum[1] = pixels.sum[2] = Vector{};
        tile.live[block] = tile.level[block] = 0, tile.bound[block] = levels[0].marked;
        for (int k = 0; k < SIXTEEN; k++) {
            bool inside = block % BLOCKS * BLOCK + k % BLOCK < wide &&
                          block / BLOCKS * BLOCK + k / BLOCK < high;
            pixels.live[k] = -inside;
            tile.live[block] += inside;
        }
        tile.remaining += tile.live[block];
    }
}

// Write a pixel's colour over the background, at most 255, rounded to nearest; and alpha.
template <class Value>
static void finish(const Pixels &pixels, int k, const Machine &m, Value *out) {
    const int64_t background[] = {m.red, m.green, m.blue};
    int64_t rest = pixels.rest[k], most = 255 << (m.visible - m.dropped), unit = m.full + 1;
    for (int c = 0; c < 3; c++) {
        int64_t behind = (rest >> m.narrower) * background[c] + (1 << (m.product - 1));
        int64_t sum = pixels.sum[c][k] + (behind >> m.product) + (1 << m.dropped >> 1);
        out[c] = min(sum >> m.dropped, most);
    }
    if (m.rgba) out[3] = (255 * (m.full - rest) + unit / 2) / unit;
}

// Rasterize a group; tiles: room for its tiles.
template <class Value> static void blend_group(int64_t group, Tile *tiles, const Frame &f) {
    const Machine &m = f.machine;
    const int64_t side = m.group, row = group / m.columns * side, column = group % m.columns * side;
    for (int64_t t = 0; t < side * side; t++)
        begin(tiles[t], m.width - (column + t % side) * TILE, m.height - (row + t / side) * TILE,
              m, f.levels);
    Pairs &counts = f.pairs[group];
    int64_t live = 0;  // one bit per tile
    for (int64_t t = 0; t < side * side; t++) live |= int64_t(tiles[t].remaining > 0) << t;
    for (int64_t k = f.start[group]; live && k < f.start[group + 1]; k++) {
        counts.entries++;
        Prepared splat = prepared(f.features[f.splat[k]], m);
        const int32_t colour[] = {int32_t(splat.red), int32_t(splat.green), int32_t(splat.blue)};
        int64_t pair = f.first[k] - 1;
        for (int64_t t = 0; t < side * side; t++) {
            if (!(f.mask[k] >> t & 1)) continue;
            pair++;
            if (!(live >> t & 1)) continue;
            f.blocks[pair] = 0;
            counts.pairs++;
            Quadratic around;
            if (!quadratic(splat, column + t % side, row + t / side, m.fraction, around)) {
                counts.far++;
                continue;
            }
            Work *work = f.work + group * m.rasterizers;
            f.blocks[pair] = blend_tile(around, colour, tiles[t], f, work);
            counts.empty += !f.blocks[pair];
            if (!tiles[t].remaining) live &= ~(int64_t(1) << t);
        }
    }
    for (int64_t y = 0; y < side * TILE && row * TILE + y < m.height; y++)
        for (int64_t x = 0; x < side * TILE && column * TILE + x < m.width; x++) {
            const Tile &tile = tiles[y / TILE * side + x / TILE];
            int block = y % TILE / BLOCK * BLOCKS + x % TILE / BLOCK;
            int64_t place = (row * TILE + y) * m.width + column * TILE + x;
            Value *out = (Value *)f.pixels + place * (m.rgba ? 4 : 3);
            finish(tile.blocks[block], y % BLOCK * BLOCK + x % BLOCK, m, out);
        }
}

// Rasterize groups `begin` … `end` − 1.
extern "C" void rasterize(int64_t begin, int64_t end, const Feature *features,
                          const int64_t *start, const int64_t *splat, const int64_t *mask,
                          const int64_t *first, const Machine *machine, const int64_t *owners,
                          const Level *levels, const int32_t *table, void *pixels, Work *work,
                          Pairs *pairs, int64_t *blocks) {
    Frame frame = {features, start,  splat, mask,   first, *machine, owners,
                   levels,   table, pixels, work, pairs, blocks};
    std::vector<Tile> tiles(machine->group * machine->group);
    auto one = machine->wide ? blend_group<int64_t> : blend_group<uint8_t>;
    for (int64_t group = begin; group < end; group++) one(group, tiles.data(), frame);
}

extern "C" void prepare(int64_t count, const Feature *features, const Machine *machine,
                        Prepared *found) {
    for (int64_t k = 0; k < count; k++) found[k] = prepared(features[k], *machine);
}

// E around tile (column, row) for each splat, and whether the splat is near it.
extern "C" void quadratics(int64_t count, const Prepared *splats, const int64_t *column,
                           const int64_t *row, int64_t fraction, Quadratic *found, uint8_t *near) {
    for (int64_t k = 0; k < count; k++)
        near[k] = quadratic(splats[k], column[k], row[k], fraction, found[k]);
}

// `twice_highest` [N, 16].
extern "C" void highest(int64_t count, const Quadratic *around, int32_t *found) {
    for (int64_t k = 0; k < count; k++) {
        Vector own = twice_highest(around[k]);
        memcpy(found + SIXTEEN * k, &own, sizeof own);
    }
}
