// A run's state in a file: the machine, its memory with all bytes, the host, and what both wrote.

#pragma once

#include <algorithm>
#include <string>
#include <type_traits>

#include "Vtop.h"
#include "host.hpp"
#include "memory.hpp"
#include "verilated_save.h"

constexpr uint64_t PAGE = 4096;  // bytes of memory that are left out if they are all 0

// Writes items to `out`, or reads them from `in`: one list of items for both.
struct State {
    VerilatedSave* out;
    VerilatedRestore* in;
    void bytes(void* at, size_t size) {
        if (out) out->write(at, size);
        else in->read(at, size);
    }
    template <class T> void item(T& value) {
        static_assert(std::is_trivially_copyable_v<T>);
        bytes(&value, sizeof value);
    }
    template <class Many> void many(Many& values) {
        uint64_t count = values.size();
        item(count);
        values.resize(count);
        for (auto& value : values) item(value);
    }
    void item(std::string& text) { many(text); }
    template <class T> void item(std::vector<T>& values) { many(values); }
    template <class T> void item(std::deque<T>& values) { many(values); }
    void item(std::map<uint32_t, uint64_t>& counts) {
        std::vector<std::pair<uint32_t, uint64_t>> pairs(counts.begin(), counts.end());
        uint64_t count = pairs.size();
        item(count);
        pairs.resize(count);
        for (auto& [id, beats] : pairs) item(id), item(beats);
        counts = {pairs.begin(), pairs.end()};
    }
    template <class... T> void items(T&... values) { (item(values), ...); }
    void file(const std::string& path) {
        std::ifstream old(path, std::ios::binary);
        std::string text{std::istreambuf_iterator<char>(old), {}};
        item(text);
        if (in) std::ofstream(path, std::ios::binary) << text;
    }
};

inline void keep(State& state, Memory& m, std::deque<Burst>& bursts) {
    uint64_t count = bursts.size();
    state.item(count);
    bursts.resize(count);
    for (Burst& burst : bursts) {
        int64_t region = burst.region ? burst.region - m.regions.data() : -1;
        state.items(burst.request, burst.response, burst.due, burst.beats, region);
        burst.region = region < 0 ? nullptr : &m.regions[region];
    }
}

inline void keep(State& state, Memory& m, uint64_t size) {
    for (Region& region : m.regions) state.items(region.read, region.written);
    for (Failing* failing : {&m.read_errors, &m.write_errors, &m.read_strays, &m.write_strays,
                             &m.read_missing, &m.write_missing})
        state.item(failing->count);
    state.items(m.tokens, m.ar, m.r, m.aw, m.w, m.b, m.noise, m.turn, m.moved, m.reading);
    state.items(m.answering, m.cycle, m.image_bytes, m.outside, m.reads_inside, m.read_beats);
    state.items(m.write_beats, m.ar_held, m.aw_held, m.w_held, m.beats_read, m.beats_written);
    state.item(m.outside_shown);
    keep(state, m, m.bursts);
    keep(state, m, m.answers);
    for (uint64_t at = 0; at < size; at += PAGE) {
        uint8_t *page = m.data + at, *end = page + std::min(PAGE, size - at);
        auto zero = [&] { return std::all_of(page, end, [](uint8_t byte) { return !byte; }); };
        bool used = state.out && !zero();
        state.item(used);
        if (used) state.bytes(page, end - page);
        else if (state.in && !zero()) std::fill(page, end, 0);
    }
}

inline void keep(State& state, Host& h) {
    Lite& l = h.lite;
    state.items(l.aw, l.w, l.b, l.ar, l.r, l.aw_left, l.w_left, l.ar_left, l.aw_on, l.w_on, l.ar_on);
    state.items(l.writing, l.reading, l.b_held, l.r_held, l.moved, l.value, l.response, l.r_value);
    state.items(h.pending, h.mask, h.seen, h.finished, h.ended, h.asked, h.next, h.at, h.left);
    state.items(h.cycle, h.rose, h.doing, h.raised, h.moved, h.result);
    for (size_t k = 0; k < h.next; k++)
        if (h.script[k][0] == "save") state.file(h.settings.folder + "/" + h.script[k][3]);
    std::fflush(h.report);
    state.file(h.settings.folder + "/report");
    std::fseek(h.report, 0, SEEK_END);
}

// Saves to a file or, with `in`, goes on from it.
inline void keep(State state, Vtop& top, Memory& memory, Host& host, uint64_t size,
                 uint64_t& cycle, uint64_t& idle) {
    if (state.out) *state.out << top;
    else *state.in >> top;
    state.items(cycle, idle);
    keep(state, memory, size);
    keep(state, host);
}
