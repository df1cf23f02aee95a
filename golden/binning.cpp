// Binning: the tiles that each splat touches, in the integers of `spec.binning`, and the lists.

#include "made.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

using std::max;
using std::min;

// A float as (−1)^negative · significand · 2^(exponent − fraction).
struct Parts {
    bool negative;
    int64_t exponent, significand;
};

// Split a code; an infinity becomes a power of two above all numbers, a NaN a larger number.
static Parts take_apart(const Machine &m, int64_t code) {
    int64_t biased = code >> m.fraction & ((1 << m.exponent) - 1), one = int64_t(1) << m.fraction;
    int64_t below = code & (one - 1), significand = biased ? below | one : below * m.subnormal;
    return {bool(code >> (m.width_bits - 1) & m.has_sign), max<int64_t>(biased, 1) - m.bias,
            significand};
}

// ⌊significand · 2^(exponent + power − fraction)⌋, or `large` if it has more than `bits` bits.
static int64_t fixed(const Machine &m, const Parts &p, int64_t power, int64_t bits, int64_t large) {
    int64_t before = max<int64_t>(0, bits - m.fraction - 1);
    int64_t amount = m.fraction + before - p.exponent - power;
    if (p.exponent + power >= bits) return large;
    return p.significand << before >> min(max<int64_t>(amount, 0), int64_t(63));
}

static Axis axis(const Machine &m, int64_t length, int64_t centre, int64_t size) {
    Axis a;
    Parts half = take_apart(m, length), middle = take_apart(m, centre);
    int64_t finest = m.screen_exponent + FINEST;
    int64_t step = max<int64_t>(half.exponent + finest + 1 - LENGTH_BITS, 0);
    a.vast = step > STEP_MAX;
    a.step = step = min(step, STEP_MAX);
    a.shift = STEP_MAX - step;
    a.half = fixed(m, half, finest - step, LENGTH_BITS, 0) + 1 + m.slack;
    int64_t magnitude = fixed(m, middle, finest - step, m.position_bits, -1);
    bool near = magnitude >= 0;
    magnitude = max<int64_t>(magnitude, 0);
    a.centre = middle.negative ? ~magnitude : magnitude;
    a.limit = (((size - 1) << FINEST) >> step) + (step > FINEST);
    a.pixel = (1 << FINEST) >> step;
    a.seen = a.vast || (near && a.centre - a.half <= a.limit && a.centre + 1 + a.half >= 0);
    return a;
}

// A ratio times 2^power with `FACTOR_FRACTION` bits, towards 0, at most just below 2.
static int64_t factor(const Machine &m, const Parts &p, int64_t power) {
    int64_t bits = FACTOR_FRACTION + 1;
    return fixed(m, p, power + FACTOR_FRACTION, bits, (1 << bits) - 1);
}

// The outline of a splat. One outside the image, or without extent, has no rows.
static Outline outline(const Machine &m, const Splat &s) {
    Outline o = {};
    o.x = axis(m, m.square ? s.radius : s.half_width, s.u, m.width);
    o.y = axis(m, m.square ? s.radius : s.half_height, s.v, m.height);
    const Axis &x = o.x, &y = o.y;
    int64_t bottom = (m.height - 1) / TILE;
    o.first = y.vast ? 0 : max<int64_t>((y.centre - y.half + y.pixel - 1) >> y.shift, 0);
    o.last = y.vast ? bottom : min((y.centre + 1 + y.half) >> y.shift, bottom);
    o.between = o.first > o.last;  // one row is visited
    bool seen = x.seen && y.seen;
    if (m.compensates)  // an opacity below 1/255 makes the square of the extent negative
        seen = seen && !take_apart(m, s.half_width).negative;
    o.last = seen ? max(o.first, o.last) : o.first - 1;
    o.box = y.vast || m.square;
    if (m.square || !seen) return o;
    o.normalise = HALF_BITS - (64 - __builtin_clzll(y.half));
    int64_t finer = y.step - o.normalise - x.step;
    Parts shear = take_apart(m, s.shear), lean = take_apart(m, s.lean);
    o.shear = factor(m, shear, finer);
    o.slope = factor(m, take_apart(m, s.slope), finer) + 1;
    int64_t power = m.screen_exponent + FINEST - y.step;
    o.lean = fixed(m, lean, power, HALF_BITS, (1 << HALF_BITS) - 1);
    if (shear.negative) o.shear = -o.shear;
    if (lean.negative) o.lean = -o.lean;
    return o;
}

// The right end of an outline in a band (sign 1), or of the mirrored outline (−1).
static int64_t right_end(const Machine &m, const Outline &o, int64_t low, int64_t high, int sign) {
    if (sign < 0) {
        std::swap(low, high);
        low = -low, high = -high;
    }
    if (low - m.margin <= o.lean && o.lean <= high + m.margin) return o.x.half;
    int64_t t = (o.lean > high ? high : low) << o.normalise, half = o.y.half << o.normalise;
    int64_t root = int64_t(std::sqrt(double((half - std::abs(t)) * (half + std::abs(t))))) + 1;
    int64_t cut = FACTOR_FRACTION - GUARD;
    return (((o.shear * t >> cut) + (o.slope * root >> cut)) >> GUARD) + 1 + m.outward;
}

// The first and last tile column in a row; first > last if it has none.
static void row_columns(const Machine &m, const Outline &o, int64_t row, int64_t *first,
                        int64_t *last) {
    const Axis &x = o.x, &y = o.y;
    int64_t last_column = (m.width - 1) / TILE;
    *first = o.between, *last = o.between ? 0 : last_column;
    if (o.between || x.vast) return;
    int64_t low = max((row << y.shift) - y.centre - 1, -y.half);
    int64_t high = min(min(((row + 1) << y.shift) - y.pixel, y.limit) - y.centre, y.half);
    int64_t right = o.box ? x.half : right_end(m, o, low, high, 1);
    int64_t left = o.box ? x.half : right_end(m, o, low, high, -1);
    *last = min((x.centre + 1 + right) >> x.shift, last_column);
    *first = max<int64_t>((x.centre - left + x.pixel - 1) >> x.shift, 0);
    if (x.centre - left > x.limit) *first = *last + 1;
}

// Find the entries of splats; return their number. Those beyond `room` are not written.
extern "C" int64_t footprints(int64_t count, const Splat *splats, const Machine *machine,
                              int64_t room, Entry *entries, int64_t *rows) {
    const Machine &m = *machine;
    const int64_t group = m.group, columns = ((m.width - 1) / TILE) / group + 1;
    std::vector<int64_t> begins(group), ends(group);
    int64_t found = 0;
    for (int64_t splat = 0; splat < count; splat++) {
        Outline o = outline(m, splats[splat]);
        rows[splat] = o.last - o.first + 1;
        for (int64_t row = o.first; row <= o.last; row++) {
            if (row == o.first || row % group == 0) {
                std::fill(begins.begin(), begins.end(), 1);
                std::fill(ends.begin(), ends.end(), 0);
            }
            row_columns(m, o, row, &begins[row % group], &ends[row % group]);
            if (row % group < group - 1 && row < o.last) continue;
            int64_t least = int64_t(1) << 30, most = -1;
            for (int64_t k = 0; k < group; k++)
                if (begins[k] <= ends[k])
                    least = min(least, begins[k] / group), most = max(most, ends[k] / group);
            for (int64_t column = least; column <= most; column++) {
                int64_t mask = 0;
                for (int64_t k = 0; k < group * group; k++) {
                    int64_t place = column * group + k % group;
                    bool reached = begins[k / group] <= place && place <= ends[k / group];
                    mask |= int64_t(reached) << k;
                }
                if (!mask) continue;
                if (found < room)
                    entries[found] = {int32_t(splat), int32_t(row / group * columns + column),
                                      int32_t(mask)};
                found++;
            }
        }
    }
    return found;
}

// The right end of each outline in a band.
extern "C" void right_ends(int64_t count, const Outline *outlines, const int64_t *low,
                           const int64_t *high, const Machine *machine, int64_t *found) {
    for (int64_t k = 0; k < count; k++)
        found[k] = right_end(*machine, outlines[k], low[k], high[k], 1);
}

// Fill bursts, first pages and counts of groups; return the bursts written. sizes: the groups,
// bursts per page, pages and entries per burst; needed: the pages needed.
extern "C" int64_t write_lists(int64_t entries, const int64_t *group, const uint64_t *slot,
                               const int64_t *sizes, int64_t *address, uint64_t *slots,
                               int64_t *first, int64_t *count, int64_t *needed) {
    const int64_t groups = sizes[0], per_page = sizes[1], pages = sizes[2], burst = sizes[3];
    std::vector<int64_t> page(groups), position(groups);  // of the next entry
    std::vector<uint64_t> buffer(groups * burst);
    int64_t written = 0;
    auto write = [&](int64_t g) {
        if (page[g] >= pages) return;
        address[written] = page[g] * per_page + position[g] / burst;
        std::copy_n(&buffer[g * burst], burst, slots + written++ * burst);
    };
    *needed = 0;
    for (int64_t entry = 0; entry < entries; entry++) {
        int64_t g = group[entry];
        bool full = position[g] == per_page * burst - 1;
        buffer[g * burst + position[g] % burst] = full ? *needed : slot[entry];
        if (position[g] % burst == burst - 1) {
            write(g);
            std::fill_n(&buffer[g * burst], burst, 0);
        }
        if (full || !count[g]) {
            page[g] = *needed, position[g] = 0;
            buffer[g * burst] = slot[entry];
            if (!count[g]) first[g] = *needed;
            *needed = min(*needed + 1, PAGE_MAX);
        }
        position[g]++, count[g]++;
    }
    for (int64_t g = 0; g < groups; g++)
        if (position[g] % burst) write(g);
    return written;
}
