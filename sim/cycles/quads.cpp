// Stage 3 with lanes in quads, cycle by cycle, splats always valid.
//
// A block of a group has a place: that of its tile · BLOCKS_A_TILE + its number in the tile.

#include "made.hpp"

#include <algorithm>
#include <vector>

using std::max;
using std::min;

// MARK_BITS per block of a tile: marks, or levels, both at most 7.
typedef uint64_t Nibbles;

static_assert(MARK_BITS == 4 && BLOCKS_A_TILE == 16);
constexpr Nibbles ONES = ~Nibbles(0) / 15, EIGHTS = 8 * ONES;

static Nibbles nibble(int64_t value, int64_t block) { return Nibbles(value) << MARK_BITS * block; }

// The blocks whose mark is above their level: 8 in each of their nibbles.
static Nibbles above(Nibbles marks, Nibbles levels) {
    return ((marks | EIGHTS) - levels - ONES) & EIGHTS;
}

template <class Item, int DEPTH> struct Queue {
    Item items[DEPTH];
    int head = 0, count = 0;

    bool full() const { return count == DEPTH; }
    const Item &front() const { return items[head]; }
    void push(const Item &item) { items[(head + count++) % DEPTH] = item; }
    void pop() { head = (head + 1) % DEPTH, count--; }
};

// Stages in a row: an item that enters in the cycle of a step is the last one LENGTH steps later.
template <class Item, int LENGTH> struct Pipeline {
    Item items[LENGTH];
    int at = 0;

    const Item &last() const { return items[at]; }
    Item &first() { return items[(at + LENGTH - 1) % LENGTH]; }
    void step() { items[at] = Item(), at = (at + 1) % LENGTH; }
};

// A pair, or the end of a group; `from`: cycle from which on a rasterizer may use it.
struct Pair {
    int64_t pair = NOTHING, tile = 0, from = 0;
};

// A visit, or the output of a block, on its way to the queues; gives: the block is output.
struct Visit {
    int64_t visit = NOTHING, place = 0;
    bool gives = false;
};

// A visit, or the output of a block, of one quad; from: cycle from which on lanes may take it.
struct Operation {
    int64_t visit, place, from;
};

struct Quad {
    int64_t level = 0, before = 0, since = 0;  // its level, known from cycle `since` on; before
    int64_t free = 0;  // cycle from which on it may enter the lanes again
};

struct Block {
    bool stale = false, touched = false;  // still to be output; blended since
    Quad quads[QUADS];
};

struct Rasterizer {
    const int64_t *order;  // places of its blocks, as they are output
    Nibbles own = 0;  // its blocks of a tile
    bool started = false;
    int64_t group = -1;
    int64_t next;  // block in `order` that may be output next
    int64_t last = 0;  // cycle in which an operation last entered the lanes
    Nibbles done = 0;  // blocks of the present pair
    int64_t waiting = 0, flying = 0;  // operations, and visits before them
    Queue<Pair, PAIRS_WAITING> pairs;
    Pipeline<Visit, STAGES> visits;
    Queue<Operation, OPERATIONS_WAITING> quads[QUADS];

    bool busy(int64_t cycle) const { return cycle <= last + RESULT_CYCLES || waiting || flying; }
};

// A frame (`visits.Visits`).
struct Frame {
    const int64_t *numbers, *start, *mask, *marks, *first;  // numbers: its groups with splats
    const uint16_t *halvings, *levels;
};

struct Stage {
    const Frame f;
    const Machine m;
    const int64_t *faint;  // halvings from which on a quad at that level skips
    const int64_t blocks = m.group * m.group * BLOCKS_A_TILE / m.rasterizers;  // of a rasterizer
    int64_t cycle = 0;
    std::vector<Rasterizer> rasterizers = std::vector<Rasterizer>(m.rasterizers);
    std::vector<Block> places = std::vector<Block>(m.group * m.group * BLOCKS_A_TILE);
    std::vector<Nibbles> levels = std::vector<Nibbles>(m.group * m.group);  // known, by tile
    int64_t live = 0;  // tiles with a block below `ended`
    // The next entry to be admitted, its group and its first pair; splats before their first pair.
    int64_t entry = f.start[f.numbers[0]], group = 0, pair = 0;
    struct Splat {
        int64_t entry, pair;
    };
    Queue<Splat, SPLATS_INSIDE> splats;
    int64_t expanded = 0, done = 0;  // the first splat's group, and its tiles that are done
    Pipeline<Pair, MARKED> pairs;  // before they are dealt
    int64_t dealt = 0, taken = 0;  // group of the last one; rasterizers that have taken it

    Stage(const Frame &frame, const Machine &machine, const int64_t *faint, const int64_t *order)
        : f(frame), m(machine), faint(faint) {
        for (Rasterizer &one : rasterizers) {
            one.order = order, one.next = blocks;
            for (int64_t k = 0; k < blocks; k++) one.own |= nibble(15, order[k] % BLOCKS_A_TILE);
            order += blocks;
        }
    }

    // Run until all groups have ended; return the cycle.
    int64_t run() {
        for (int64_t left = m.groups * m.rasterizers; left;) {
            cycle++;
            for (int lanes = 0; lanes < m.rasterizers / SHARE; lanes++)
                for (int quad = 0; quad < QUADS; quad++) choose(lanes, quad);
            for (Rasterizer &one : rasterizers)
                if (send(one)) left -= issue(one);
            if (deal()) {
                pairs.step();
                expand();
            }
            admit();
        }
        return cycle;
    }

    // Take an operation from the longer of a quad's queues, if its block is not in flight.
    void choose(int lanes, int quad) {
        Rasterizer *sharing[SHARE];
        int own[SHARE], count[SHARE];
        for (int k = 0; k < SHARE; k++) {
            sharing[k] = &rasterizers[lanes + k * m.rasterizers / SHARE];
            own[k] = QUAD_OF[QUADS * k + quad], count[k] = sharing[k]->quads[own[k]].count;
        }
        int first = count[0] == count[1] ? cycle & 1 : count[1] > count[0], second = first ^ 1;
        if (!count[first]) return;
        if (!blend(*sharing[first], own[first])) blend(*sharing[second], own[second]);
    }

    // Let the next operation of a rasterizer's quad enter the lanes; return whether it could.
    bool blend(Rasterizer &one, int number) {
        auto &queue = one.quads[number];
        if (!queue.count) return false;
        const auto [visit, place, from] = queue.front();
        Quad &quad = places[place].quads[number];
        if (max(from, quad.free) > cycle) return false;
        queue.pop(), one.waiting--, one.last = cycle, quad.free = cycle + BUSY;
        if (visit < 0) return true;
        if (quad.since <= cycle) quad.before = quad.level;
        quad.level = f.levels[visit] >> QUAD_BITS * number & 15, quad.since = cycle + LEVEL_LATENCY;
        return true;
    }

    // Push the visit at the end of the pipeline to its quads; return whether it could leave.
    bool send(Rasterizer &one) {
        if (!one.flying) return true;
        const auto [visit, place, gives] = one.visits.last();
        if (visit != NOTHING) {
            Block &block = places[place];
            int64_t least, needs = needed(block, visit, gives, least);
            for (int quad = 0; quad < QUADS; quad++)
                if (needs >> quad & 1 && one.quads[quad].full()) return false;
            if (needs) block.touched = visit >= 0;
            if (!gives) raise(place, least);
            for (int quad = 0; quad < QUADS; quad++) {
                if (!(needs >> quad & 1)) continue;
                one.quads[quad].push({visit, place, cycle + QUEUE_LATENCY});
                one.waiting++;
            }
            one.flying--;
        }
        one.visits.step();
        return true;
    }

    // The quads that a visit needs; least: output, the level of the block.
    int64_t needed(const Block &block, int64_t visit, bool gives, int64_t &least) const {
        const int64_t halvings = visit < 0 ? UNSEEN : f.halvings[visit];
        const bool whole = gives || (halvings != UNSEEN && !block.touched);
        int64_t needs = 0;
        least = m.ended;
        for (int quad = 0; quad < QUADS; quad++) {
            const Quad &q = block.quads[quad];
            int64_t level = q.since <= cycle ? q.level : q.before;
            least = min(least, level);
            bool seen = (halvings >> QUAD_BITS * quad & 15) < faint[level];
            needs |= int64_t(whole || seen) << quad;
        }
        return needs;
    }

    // Raise the known level of a block.
    void raise(int64_t place, int64_t level) {
        int64_t tile = place / BLOCKS_A_TILE, block = place % BLOCKS_A_TILE;
        Nibbles &all = levels[tile];
        if (level <= int64_t(all >> MARK_BITS * block & 15)) return;
        all = (all & ~nibble(15, block)) | nibble(level, block);
        if (all == ONES * m.ended) live &= ~(int64_t(1) << tile);
    }

    // Issue a rasterizer's next block; return whether its group ends.
    bool issue(Rasterizer &one) {
        if (!one.started) {
            if (one.group + 1 < m.groups && !one.busy(cycle)) begin(one);
            return false;
        }
        bool end = false, issued = false;
        if (one.pairs.count && one.pairs.front().from <= cycle) {
            end = one.pairs.front().pair == END;
            issued = !end && visit(one);
        }
        if (one.next < blocks) {
            int64_t place = one.order[one.next];
            bool stale = places[place].stale;
            if (stale && !issued) enter(one, place, OUTPUT);
            one.next += !stale || !issued;
            return false;
        }
        if (!end || one.busy(cycle)) return false;
        one.pairs.pop(), one.started = false, one.next = 0;
        for (int64_t k = 0; k < blocks; k++) places[one.order[k]].stale = true;
        return true;
    }

    // Begin a rasterizer's next group: pixels outside the image have ended.
    void begin(Rasterizer &one) {
        one.started = true, one.group++;
        const int64_t number = f.numbers[one.group], side = m.group;
        for (int64_t k = 0; k < blocks; k++) {
            const int64_t place = one.order[k];
            const int64_t tile = place / BLOCKS_A_TILE, block = place % BLOCKS_A_TILE;
            int64_t y = (number / m.columns * side + tile / side) * TILE + block / BLOCKS * BLOCK;
            int64_t x = (number % m.columns * side + tile % side) * TILE + block % BLOCKS * BLOCK;
            int64_t least = m.ended;
            for (int quad = 0; quad < QUADS; quad++) {
                int64_t row = QUAD_FIRST[quad] / BLOCK, column = QUAD_FIRST[quad] % BLOCK;
                int64_t level = y + row < m.height && x + column < m.width ? 0 : m.ended;
                Quad &q = places[place].quads[quad];
                q.level = q.before = level, q.since = 0, least = min(least, level);
            }
            levels[tile] = (levels[tile] & ~nibble(15, block)) | nibble(least, block);
        }
        live = 0;
        for (size_t tile = 0; tile < levels.size(); tile++)
            live |= int64_t(levels[tile] != ONES * m.ended) << tile;
    }

    void enter(Rasterizer &one, int64_t place, int64_t visit) {
        one.visits.first() = {visit, place, places[place].stale};
        places[place].stale = false, one.flying++;
    }

    // Issue the present pair's next block; return whether there was one.
    bool visit(Rasterizer &one) {
        const auto [pair, tile, from] = one.pairs.front();
        const Nibbles marks = f.marks[pair];
        const Nibbles left = above(marks, levels[tile]) & one.own & ~one.done;
        const Nibbles chosen = left & -left;
        if (left) {
            int64_t block = __builtin_ctzll(chosen) / MARK_BITS;
            int64_t before = __builtin_popcountll(above(marks, 0) & (chosen - 1));
            enter(one, tile * BLOCKS_A_TILE + block, f.first[pair] + before);
        }
        one.done |= chosen;
        if (left == chosen) one.pairs.pop(), one.done = 0;
        return left;
    }

    // Deal a pair to its rasterizers; return whether all have taken it.
    bool deal() {
        const auto [pair, tile, from] = pairs.last();
        if (pair == NOTHING) return true;
        Nibbles reached = EIGHTS;
        if (pair != END) {
            Nibbles known = 0;
            for (const Rasterizer &one : rasterizers)
                known |= one.started && one.group == dealt ? one.own : 0;
            reached = above(f.marks[pair], levels[tile] & known);
        }
        bool all_took = true;
        for (int r = 0; r < m.rasterizers; r++) {
            Rasterizer &one = rasterizers[r];
            if (taken >> r & 1 || !(reached & one.own)) continue;
            if (one.pairs.full()) {
                all_took = false;
                continue;
            }
            one.pairs.push({pair, tile, cycle + QUEUE_LATENCY});
            taken |= int64_t(1) << r;
        }
        if (all_took) taken = 0, dealt += pair == END;
        return all_took;
    }

    // The live tiles of a mask if all rasterizers are at a group; otherwise all of its tiles.
    int64_t live_of(int64_t mask, int64_t number) const {
        for (const Rasterizer &one : rasterizers)
            if (!one.started || one.group != number) return mask;
        return mask & live;
    }

    // Take the next splat, or drop it if none of its tiles is live.
    void admit() {
        if (group == m.groups || splats.full()) return;
        if (entry == f.start[f.numbers[group] + 1]) {
            splats.push({END, 0});
            if (++group < m.groups) entry = f.start[f.numbers[group]];
            return;
        }
        if (live_of(f.mask[entry], group)) splats.push({entry, pair});
        pair += __builtin_popcountll(f.mask[entry++]);
    }

    // Issue the next pair of a splat and a live tile.
    void expand() {
        if (!splats.count) return;
        const auto [number, first] = splats.front();
        if (number == END) {
            pairs.first() = {END}, expanded++;
        } else {
            int64_t mask = f.mask[number], left = live_of(mask, expanded) & ~done;
            int64_t lowest = left & -left;
            if (left) {
                int64_t before = __builtin_popcountll(mask & (lowest - 1));
                pairs.first() = {first + before, __builtin_ctzll(lowest)};
            }
            done |= lowest;
            if (left != lowest) return;
        }
        done = 0;
        splats.pop();
    }
};

// Return the cycle in which the last group ends.
// numbers: groups with a splat
// order: places of each rasterizer's blocks as they are output
extern "C" int64_t run(const int64_t *numbers, const int64_t *start, const int64_t *mask,
                       const int64_t *marks, const int64_t *first, const uint16_t *halvings,
                       const uint16_t *levels, const Machine *machine, const int64_t *faint,
                       const int64_t *order) {
    const Frame frame = {numbers, start, mask, marks, first, halvings, levels};
    return Stage(frame, *machine, faint, order).run();
}
