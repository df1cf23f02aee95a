// Blocks that marking cannot leave out, of lanes in quads: what each visit does to a quad's level.
// Comes behind golden's raster.cpp.

// The levels of a block's pixels.
static Vector levels_of(const Pixels &pixels, const Level *levels, int64_t ended) {
    Vector level = {};
    for (int64_t k = 0; k < ended; k++) level -= pixels.rest < int32_t(levels[k].above);
    return pixels.live ? level : int32_t(ended) - Vector{};
}

// The least of each quad's pixels, `QUAD_BITS` per quad.
static uint16_t least_of(Vector pixels) {
    int32_t all = 0;
    for (int quad = 0; quad < QUADS; quad++) {
        const int64_t *own = QUAD_PIXELS + SIXTEEN / QUADS * quad;
        int32_t one = min(pixels[own[0]], pixels[own[1]]);
        int32_t other = min(pixels[own[2]], pixels[own[3]]);
        all |= min(one, other) << QUAD_BITS * quad;
    }
    return all;
}

// Blend a splat into a block, and find the visit's two numbers; return the number of ended pixels.
static int visit(const Quadratic &around, Pixels &pixels, const Machine &m, const Level *levels,
                 int64_t ended, const int32_t *table, uint16_t &halvings, uint16_t &reached) {
    Vector exponent = exponents(around, m), visible = exponent >= int32_t(m.lowest);
    Vector own = -1 - ((exponent < 0 ? exponent : Vector{} - 1) >> int32_t(m.finer + m.steps));
    const int32_t colour[] = {0, 0, 0};
    int gone = blend_block(around, colour, pixels, m, table).ended;
    halvings = least_of(visible ? own : int32_t(NOT_SEEN) - Vector{});
    reached = least_of(levels_of(pixels, levels, ended));
    return gone;
}

// Fill the arrays of `visits.Visits`; return the number of visits.
extern "C" int64_t trace(int64_t groups, const int64_t *start, const int64_t *splat,
                         const int64_t *mask, const Prepared *splats, const Machine *machine,
                         const Level *levels, int64_t ended, const int32_t *table, int64_t *marks,
                         int64_t *first, uint16_t *halvings, uint16_t *reached) {
    const Machine &m = *machine;
    const int64_t side = m.group;
    std::vector<Tile> tiles(side * side);
    int64_t count = 0, pair = 0;
    for (int64_t group = 0; group < groups; group++) {
        int64_t row = group / m.columns * side, column = group % m.columns * side, live = 0, late = 0;
        for (int64_t t = 0; t < side * side; t++) {
            begin(tiles[t], m.width - (column + t % side) * TILE,
                  m.height - (row + t / side) * TILE, m, levels);
            live += tiles[t].remaining;
        }
        for (int64_t k = start[group]; k < start[group + 1]; k++) {
            late += live == 0;
            for (int64_t t = 0; t < side * side; t++) {
                if (!(mask[k] >> t & 1)) continue;
                first[pair++] = count;
                Quadratic around;
                if (late > LATE || !quadratic(splats[splat[k]], column + t % side, row + t / side,
                                              m.fraction, around))
                    continue;
                Vector highest = twice_highest(around);
                for (int block = 0; block < SIXTEEN; block++) {
                    int64_t marked = 0;
                    while (marked < ended && highest[block] >= levels[marked].marked) marked++;
                    if (!marked) continue;
                    marks[pair - 1] |= marked << MARK_BITS * block;
                    live -= visit(around_block(around, X[block], Y[block]), tiles[t].blocks[block],
                                  m, levels, ended, table, halvings[count], reached[count]);
                    count++;
                }
            }
        }
    }
    first[pair] = count;
    return count;
}
