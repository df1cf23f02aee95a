// The reference renderer's inner loops: the tiles that a splat touches, and blending a tile.

#include "made.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

using std::max;
using std::min;

// Minimum of A·x² + 2·B·x·y + C·y² over the rectangle [x0, x1] × [y0, y1].
//
// The form is convex with its minimum 0 at the origin. Outside of it, the minimum is on an edge
// that faces the origin.
static double smallest(const double *conic, double x0, double x1, double y0, double y1) {
    if (x0 <= 0 && 0 <= x1 && y0 <= 0 && 0 <= y1) return 0;
    const double a = conic[0], b = conic[1], c = conic[2];
    double best = INFINITY;
    auto meet = [&](double x, double y) {
        best = min(best, a * x * x + 2 * b * x * y + c * y * y);
    };
    for (double x : {x0, x1})  // c is 0 if the determinant overflows
        meet(x, c > 0 ? min(max(-b * x / c, y0), y1) : y0);
    for (double y : {y0, y1}) meet(a > 0 ? min(max(-b * y / a, x0), x1) : x0, y);
    return best;
}

extern "C" void smallest_q(int64_t count, const double *conic, const double *edges, double *found) {
    for (int64_t k = 0; k < count; k++, edges += 4)
        found[k] = smallest(conic + 3 * k, edges[0], edges[1], edges[2], edges[3]);
}

// Count the tiles in the boxes [M, 4] per tile in `slot`, or, if `room`, write the lists from
// `slot` on. reach: only tiles that are really reached; null: all.
extern "C" void visit_tiles(int64_t count, const double *centre, const double *conic,
                            const double *reach, const int32_t *boxes, const int64_t *sizes,
                            int64_t *slot, int32_t *splat) {
    const int64_t width = sizes[0], height = sizes[1], exact = sizes[2], room = sizes[3];
    const int64_t columns = (width + TILE - 1) / TILE;
    for (int64_t m = 0; m < count; m++) {
        const double u = centre[2 * m], v = centre[2 * m + 1];
        const int32_t *box = boxes + 4 * m;
        for (int64_t row = box[2]; row <= box[3]; row++) {
            double y0 = row * TILE - v, y1 = min(row * TILE + TILE, height) - 1 - v;
            for (int64_t column = box[0]; column <= box[1]; column++) {
                double x0 = column * TILE - u, x1 = min(column * TILE + TILE, width) - 1 - u;
                if (exact && smallest(conic + 3 * m, x0, x1, y0, y1) > reach[m]) continue;
                int64_t tile = row * columns + column;
                if (room) splat[slot[tile]] = m;
                slot[tile]++;
            }
        }
    }
}

// The integers of first … end − 1 within [low, high], finite or infinite: the first and the last.
static void within(double low, double high, int64_t *first, int64_t *last) {
    *first = int64_t(max(std::ceil(low), double(*first)));
    *last = int64_t(min(std::floor(high), double(*last)));
}

// Blend the splats of tiles `begin` … `end` − 1 into the image.
extern "C" void blend_tiles(int64_t begin, int64_t end, const int64_t *sizes, const int64_t *start,
                            const int32_t *list, const double *centre, const double *conic,
                            const double *opacity, const double *reach, const double *extent,
                            const double *colour, const Limits *limits, double *image,
                            double *transmittance, Work *works) {
    const int64_t width = sizes[0], height = sizes[1], columns = (width + TILE - 1) / TILE;
    const Limits &limit = *limits;
    for (int64_t tile = begin; tile < end; tile++) {
        const int64_t top = tile / columns * TILE, left = tile % columns * TILE;
        const int64_t right = min(left + TILE, width), bottom = min(top + TILE, height);
        bool live[TILE * TILE];
        std::fill_n(live, TILE * TILE, true);
        int64_t alive = (right - left) * (bottom - top);
        Work work = {};
        for (int64_t pair = start[tile]; alive && pair < start[tile + 1]; pair++) {
            work.pairs++;
            const int64_t m = list[pair];
            const double u = centre[2 * m], v = centre[2 * m + 1];
            const double a = conic[3 * m], b = conic[3 * m + 1], c = conic[3 * m + 2];
            const double wide = extent[2 * m] * (1 + limit.slack) + limit.slack;
            const double high = extent[2 * m + 1] * (1 + limit.slack) + limit.slack;
            const double most = reach[m] * (1 + limit.slack) + limit.slack;
            int64_t x0 = left, x1 = right - 1, y0 = top, y1 = bottom - 1, blocks = 0;
            within(u - wide, u + wide, &x0, &x1);
            within(v - high, v + high, &y0, &y1);
            for (int64_t y = y0; y <= y1; y++) {
                const double dy = y - v;
                double q[TILE];
                for (int64_t x = x0; x <= x1; x++) {
                    const double dx = x - u;
                    q[x - x0] = a * dx * dx + 2 * b * dx * dy + c * dy * dy;
                }
                for (int64_t x = x0; x <= x1; x++) {
                    bool &shines = live[(y - top) * TILE + x - left];
                    if (!shines || q[x - x0] > most) continue;
                    double alpha = min(limit.alpha_max, opacity[m] * std::exp(-0.5 * q[x - x0]));
                    if (alpha < limit.alpha_min) continue;
                    double &t = transmittance[y * width + x];
                    if (t < limit.dark && t * alpha < limit.taken) continue;
                    blocks |= 1 << ((y - top) / BLOCK * (TILE / BLOCK) + (x - left) / BLOCK);
                    double rest = t * (1 - alpha);
                    if (rest < limit.ends) {
                        shines = false;
                        alive--;
                        work.ended++;
                        if (!limit.takes_all) continue;
                        rest = 0;
                    }
                    const double weight = rest != 0 ? t * alpha : t;
                    double *pixel = image + 3 * (y * width + x);
                    for (int k = 0; k < 3; k++) pixel[k] += weight * colour[3 * m + k];
                    t = rest;
                    work.contributions++;
                }
            }
            work.blocks += __builtin_popcountll(blocks);
        }
        works[tile] = work;
    }
}
