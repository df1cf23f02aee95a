// Counts changes of nets in a run (SAIF).

#pragma once

#include "Vtop.h"
#include "memory.hpp"
#include "settings.hpp"
#include "verilated_saif_c.h"

// Counts how often each net changes and how long it is 1, sampled at the end of each cycle: in the
// first of every `every` windows of `length` cycles. With `steady`, two bits of INTERRUPT, only
// from when the first frame's points are ready until its tiles are finished and the second frame's
// points are ready, as seen from the driver clearing INTERRUPT. The file's time is the number of
// sampled cycles.
struct Window {
    VerilatedSaifC saif;
    Vtop& top;
    uint64_t length, every, interrupt, ready_bit = 0, frame_bit = 0, ready = 1, finished = 0;
    uint64_t start = UINT64_MAX, begun = UINT64_MAX, ended = 0, time = 0;
    bool clears = false;
    Window(Vtop& top, Memory&, Settings& s)
        : top(top), length(s.number("sample_length")), every(s.number("sample_every")),
          interrupt(s.number("interrupt")) {
        if (!s.all("steady").empty()) {
            ready = 0;
            ready_bit = std::stoull(s.all("steady")[0][0]);
            frame_bit = std::stoull(s.all("steady")[0][1]);
        }
        top.trace(&saif, 99);
        saif.open((s.folder + "/waves.saif").c_str());
    }
    void dump(uint64_t cycle, bool high) {
        if (high) return;
        bool before = clears;
        clears = top.s_axi___05Fawvalid && top.s_axi___05Fawaddr == interrupt;
        if (clears && !before) {
            ready += (top.s_axi___05Fwdata & ready_bit) != 0;
            finished += (top.s_axi___05Fwdata & frame_bit) != 0;
        }
        if (ready == 0 || (ready > 1 && finished > 0)) return;
        if (start == UINT64_MAX) start = cycle;
        if ((cycle - start) / length % every) return;
        saif.dump(time++);
        if (begun == UINT64_MAX) begun = cycle;
        ended = cycle;
    }
    void close() { saif.close(); }
};
