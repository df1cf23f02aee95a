// Floating point of the PE arrays: float64 values, rounded to a format at once; codes; 1/x and 1/√x.

#include "made.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

using std::max;
using std::min;

constexpr int PLACES = 52;              // bits of float64's fraction
constexpr double ONES = 1LL << PLACES;  // its sum with a smaller number is a whole number

static int64_t bits_of(double value) {
    int64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

static double value_of(int64_t bits) {
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

// The nearest value of the format, ties to even; NaN stays.
static inline double rounded(double value, const Format &f) {
    double size = std::fabs(value);
    int64_t bits = bits_of(size), cut = PLACES - f.fraction;
    bits = (bits + ((1LL << cut >> 1) - 1) + (bits >> cut & 1)) >> cut << cut;
    double near = value_of(bits);
    near = near > f.largest ? f.most : near;
    near = size < f.lowest ? (size * f.units + ONES - ONES) * f.unit : near;
    near = f.has_sign || value > 0 ? std::copysign(near, value) : 0.0;
    near = f.zero_sign ? near : near + 0.0;
    return value == value ? near : __builtin_nan("");
}

// The code of a value that is not NaN.
static inline uint64_t encoded(double value, const Format &f) {
    value = rounded(value, f);
    double size = std::fabs(value);
    int64_t code = (bits_of(size) >> (PLACES - f.fraction)) + ((f.bias - 1023) << f.fraction);
    if (size < f.lowest) code = int64_t(size * f.units);
    if (size == INFINITY) code = ((1LL << f.exponent) - 1) << f.fraction;
    bool negative = f.has_sign && std::signbit(value);
    return uint64_t(code) | uint64_t(negative) << (f.exponent + f.fraction);
}

static inline double decoded(int64_t code, const Format &f) {
    int64_t ends = (1LL << f.exponent) - 1;
    int64_t biased = code >> f.fraction & ends, below = code & ((1LL << f.fraction) - 1);
    int64_t bits = ((biased + 1023 - f.bias) << PLACES) + (below << (PLACES - f.fraction));
    double value = value_of(bits);
    if (!biased) value = f.subnormal ? below * f.unit : 0.0;
    if (biased == ends && f.zero_sign) value = below ? NAN : INFINITY;  // it has infinities
    if (f.has_sign && code >> (f.exponent + f.fraction)) value = -value;
    return f.zero_sign ? value : value + 0.0;
}

// Call a function with codes of 1, 2, 4 or 8 bytes.
template <class Function> static void with_codes(int64_t bytes, void *codes, Function function) {
    if (bytes == 1) function((uint8_t *)codes);
    if (bytes == 2) function((uint16_t *)codes);
    if (bytes == 4) function((uint32_t *)codes);
    if (bytes == 8) function((uint64_t *)codes);
}

// Round values; return whether one is NaN.
extern "C" int64_t round_values(int64_t count, const double *values, double *found,
                                const Format *format) {
    const Format f = *format;
    int64_t nan = 0;
    for (int64_t k = 0; k < count; k++) {
        found[k] = rounded(values[k], f);
        nan |= values[k] != values[k];
    }
    return nan;
}

// Encode values; return whether one is NaN, whose code has no meaning.
extern "C" int64_t encode(int64_t count, const double *values, void *codes, int64_t bytes,
                          const Format *format) {
    const Format f = *format;
    int64_t nan = 0;
    with_codes(bytes, codes, [&](auto *found) {
        for (int64_t k = 0; k < count; k++) {
            found[k] = encoded(values[k], f);
            nan |= values[k] != values[k];
        }
    });
    return nan;
}

extern "C" void decode(int64_t count, void *codes, int64_t bytes, double *found,
                       const Format *format) {
    const Format f = *format;
    with_codes(bytes, codes, [&](auto *some) {
        for (int64_t k = 0; k < count; k++) found[k] = decoded(some[k], f);
    });
}

// Run the PE steps of a program. steps: [S, 5] numbers of result, a, b and c, and whether the
// product is subtracted; values: [V, N].
extern "C" void evaluate(int64_t count, const int64_t *steps, int64_t items, double *values,
                         const Format *format) {
    const Format f = *format;
    for (int64_t s = 0; s < count; s++, steps += 5) {
        const double *a = values + steps[1] * items, *b = values + steps[2] * items;
        const double *c = values + steps[3] * items, sign = steps[4] ? -1.0 : 1.0;
        double *made = values + steps[0] * items;
        const bool product = steps[2] != ABSENT, sum = steps[3] != ABSENT;
        if (product && sum)
            for (int64_t k = 0; k < items; k++)
                made[k] = rounded(c[k] + sign * rounded(a[k] * b[k], f), f);
        else if (product)
            for (int64_t k = 0; k < items; k++) made[k] = sign * rounded(a[k] * b[k], f);
        else if (sum)
            for (int64_t k = 0; k < items; k++) made[k] = rounded(c[k] + sign * a[k], f);
        else
            for (int64_t k = 0; k < items; k++) made[k] = sign * a[k];
    }
}

// The code of 1/x or 1/√x, from the code of x (`spec.unary`).
static int64_t unary(int64_t code, const Format &f, const Path &p, const int64_t *offset,
                     const int64_t *slope, const int64_t *curve) {
    const int64_t one = 1LL << f.fraction, low = one - 1, exponents = (1LL << f.exponent) - 1;
    int64_t fraction = code & low, biased = code >> f.fraction & exponents;
    if (f.subnormal && !biased) {
        int64_t length = fraction ? 64 - __builtin_clzll(fraction) : 0;
        int64_t places = min(f.fraction + 1 - length, f.fraction);
        fraction = fraction << places & low, biased = 1 - places;
    }
    int64_t exponent = p.rsqrt ? f.bias - 1 - ((biased - f.bias) >> 1) : 2 * f.bias - 1 - biased;
    int64_t address = fraction >> p.rest;
    if (p.rsqrt) address |= ((biased & 1) ^ 1) << p.index;  // the bias is odd
    int64_t total = offset[address] << (p.point - p.guard);
    if (p.degree >= 1) total += slope[address] * (~fraction & ((1LL << p.rest) - 1));
    if (p.degree >= 2) {
        int64_t half = 1LL << (p.rest - 1);
        int64_t a = ((fraction & half ? fraction : ~fraction) & (half - 1)) >> p.reach_drop;
        total += curve[address] * (a * (a + 1) >> p.square_drop) << p.curve_shift;
    }
    total &= (2LL << (f.fraction + p.point)) - 1;
    // (1 + total · 2^−(point + fraction)) · 2^exponent, rounded
    int64_t end = exponents - f.zero_sign;  // the largest finite value's
    int64_t found = (min(max<int64_t>(exponent, 1), end + 1) << f.fraction) + (total >> p.point);
    if (f.subnormal && exponent < 1) {
        int64_t places = min(1 - exponent, f.fraction + 3);
        int64_t half_units = ((1LL << places) - 1) << (p.point - 1);
        found = ((1LL << (f.fraction + p.point)) + total + half_units) >> (p.point + places);
    }
    if (!f.subnormal && exponent == 0) found = one;
    if (!f.subnormal && exponent < 0) found = 0;  // half of the smallest value: the even code is 0
    const int64_t infinite = (end + 1) << f.fraction, saturates = !f.zero_sign;
    found = min(found, infinite - saturates);
    int64_t size = code & ((1LL << (f.exponent + f.fraction)) - 1);
    bool negative = f.has_sign && code >> (f.exponent + f.fraction) & 1;
    bool zero = size < (f.subnormal ? 1 : one);
    if (zero) found = infinite - saturates;
    if (!saturates && size == infinite) found = 0;
    bool nan = size > infinite;
    if (p.rsqrt) {
        if (saturates && negative) found = infinite - 1;
        nan = nan || (negative && !zero && !saturates);
        negative = negative && zero && !saturates;
    }
    if (saturates) negative = negative && found, nan = false;
    if (nan) return infinite | one >> 1;
    return found | int64_t(negative) << (f.exponent + f.fraction);
}

extern "C" void unary_codes(int64_t count, const int64_t *codes, int64_t *found,
                            const Format *format, const Path *path, const int64_t *offset,
                            const int64_t *slope, const int64_t *curve) {
    for (int64_t k = 0; k < count; k++)
        found[k] = unary(codes[k], *format, *path, offset, slope, curve);
}

// The same for values that are not NaN.
extern "C" void unary_values(int64_t count, const double *values, double *found,
                             const Format *format, const Path *path, const int64_t *offset,
                             const int64_t *slope, const int64_t *curve) {
    const Format f = *format;
    const Path p = *path;
    for (int64_t k = 0; k < count; k++)
        found[k] = decoded(unary(encoded(values[k], f), f, p, offset, slope, curve), f);
}
