// Waveforms (VCD or FST) of a part of a run.

#pragma once

#include "Vtop.h"
#include "memory.hpp"
#include "settings.hpp"

#if FST
#include "verilated_fst_c.h"
using Traced = VerilatedFstC;
constexpr const char* WAVES_FILE = "/waves.fst";
#else
#include "verilated_vcd_c.h"
using Traced = VerilatedVcdC;
constexpr const char* WAVES_FILE = "/waves.vcd";
#endif

// The file: signals of `scope`, a module, down to a number of levels; of all modules without it.
struct Waves : Traced {
    Waves(Vtop& top, Settings& s) {
        top.trace(this, 99);
        if (!s.all("scope").empty()) {
            Line scope = s.all("scope")[0];
            dumpvars(std::stoi(scope[0]), scope[1]);
        }
        open((s.folder + WAVES_FILE).c_str());
    }
};

// Records a window: given cycles, or from a read of an address until all bytes of a rectangle of
// the image have been written.
struct Window {
    Waves waves;
    uint64_t first = 0, last = UINT64_MAX, image = 0, stride = 1, x0 = 0, x1 = 0, y0 = 0, y1 = 0;
    int64_t left = 0;
    uint64_t begun = UINT64_MAX, ended = UINT64_MAX;
    Window(Vtop& top, Memory& memory, Settings& s) : waves(top, s) {
        auto all = [&](const char* name) {
            std::vector<uint64_t> found;
            for (auto& word : s.all(name)[0]) found.push_back(std::stoull(word));
            return found;
        };
        if (!s.all("window").empty()) first = all("window")[0], last = all("window")[1];
        if (s.all("watch").empty()) return;
        auto watch = all("watch");
        uint64_t address = watch[0];
        image = watch[1], stride = watch[2], x0 = watch[3], x1 = watch[4], y0 = watch[5];
        y1 = watch[6];
        left = (x1 - x0) * (y1 - y0), first = UINT64_MAX;
        memory.on_read = [this, &memory, address](uint64_t from, uint64_t bytes) {
            if (first == UINT64_MAX && from <= address && address < from + bytes)
                first = memory.cycle;
        };
        memory.on_write = [this, &memory](uint64_t from, uint32_t strobe) {
            for (uint64_t k = 0; k < BEAT; k++) {
                uint64_t offset = from + k - image;
                if (from + k < image || !(strobe >> k & 1)) continue;
                uint64_t x = offset % stride, y = offset / stride;
                if (x0 <= x && x < x1 && y0 <= y && y < y1 && --left == 0) last = memory.cycle + 8;
            }
        };
    }
    void dump(uint64_t cycle, bool high) {
        if (cycle < first || cycle > last) return;
        if (begun == UINT64_MAX) begun = cycle;
        ended = cycle;
        waves.dump(10 * cycle + 5 * high);
    }
    void close() { waves.close(); }
};
