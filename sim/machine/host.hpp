// The machine's host: runs a script over AXI4-Lite.
//
// A wait collects the bits of INTERRUPT in `pending`, with the cycle at which the interrupt rose,
// and ends when one of its bits is set. FRAME may stand for two ends if the second comes before the
// bit is cleared; FINISHED, read afterwards, counts them. An error outside of the wait's mask, or a
// machine without activity, ends the script; its last part, after `finally`, still runs.
//
// With `live`, lines of standard input follow the script, each read when the previous command is
// done; the answer to each command goes to standard output: `answer`, value and response.

#pragma once

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <iostream>
#include <string>
#include <vector>

#include "Vtop.h"
#include "config.hpp"
#include "memory.hpp"
#include "random.hpp"
#include "settings.hpp"

#define LITE(signal) top.s_axi___05F##signal
#define INTERRUPT top.__SYM__interrupt  // Verilator's name: `interrupt` is on its list of C++ words

// One access of the host's AXI4-Lite master at a time.
struct Lite {
    Vtop& top;
    Stall aw, w, b, ar, r;
    bool aw_left = false, w_left = false, ar_left = false;           // not accepted yet
    bool aw_on = false, w_on = false, ar_on = false;                 // offered
    bool writing = false, reading = false, b_held = false, r_held = false, moved = false;
    uint32_t value = 0, response = 0, r_value = 0;
    std::string rule;
    Lite(Vtop& top, Settings& s)
        : top(top), aw(s.stall()), w(s.stall()), b(s.stall()), ar(s.stall()), r(s.stall()) {}
    bool busy() const { return writing || reading; }
    void forget() {
        aw_left = w_left = ar_left = aw_on = w_on = ar_on = writing = reading = false;
        b_held = r_held = false;
        LITE(awvalid) = LITE(wvalid) = LITE(arvalid) = 0;
    }
    void write(uint32_t address, uint32_t data) {
        writing = aw_left = w_left = true;
        LITE(awaddr) = address, LITE(wdata) = data, LITE(wstrb) = 15;
    }
    void read(uint32_t address) {
        reading = ar_left = true;
        LITE(araddr) = address;
    }
    void drive() {
        aw_on = aw_left && (aw_on || !aw.idle());
        w_on = w_left && (w_on || !w.idle());
        ar_on = ar_left && (ar_on || !ar.idle());
        LITE(awvalid) = aw_on, LITE(wvalid) = w_on, LITE(arvalid) = ar_on;
        LITE(bready) = !b.idle(), LITE(rready) = !r.idle();
    }
    void clock() {
        moved = false;
        if (LITE(bvalid) && (!writing || aw_left || w_left)) rule = "B without a write";
        if (LITE(rvalid) && (!reading || ar_left)) rule = "R without a read";
        if (b_held && !LITE(bvalid)) rule = "B was not kept";
        if (r_held && !(LITE(rvalid) && LITE(rdata) == r_value)) rule = "R was not kept";
        b_held = LITE(bvalid) && !LITE(bready);
        r_held = LITE(rvalid) && !LITE(rready);
        r_value = LITE(rdata);
        if (aw_on && LITE(awready)) aw_left = aw_on = false, moved = true;
        if (w_on && LITE(wready)) w_left = w_on = false, moved = true;
        if (ar_on && LITE(arready)) ar_left = ar_on = false, moved = true;
        if (LITE(bvalid) && LITE(bready)) {
            writing = false, moved = true, response = LITE(bresp);
        }
        if (LITE(rvalid) && LITE(rready)) {
            reading = false, moved = true, response = LITE(rresp), value = LITE(rdata);
        }
    }
};

struct Host {
    Vtop& top;
    Memory& memory;
    Settings& settings;
    Lite lite;
    std::vector<Line> script;
    FILE* report;
    uint32_t interrupt_register, finished_register, pending = 0, mask = 0, seen = 0;
    uint16_t finished = 0;          // last value read
    uint64_t ended = 0, asked = 0;  // frames not yet waited for; when the interrupt rose
    size_t next = 0, at = 0, last_resort = 0;
    uint64_t left = 0, cycle = 0, rose = 0;
    enum { nothing, access, waiting, asking, clearing, ending, counting, resetting } doing = resetting;
    bool raised = false, over = false, moved = false, live;
    std::string result = "done";

    Host(Vtop& top, Memory& memory, Settings& s)
        : top(top), memory(memory), settings(s), lite(top, s), script(s.read("script")),
          report(std::fopen((s.folder + "/report").c_str(), "w")),
          interrupt_register(s.number("interrupt")),
          finished_register(s.number("finished")), left(2), live(!s.all("live").empty()) {
        at = last_resort = script.size();
        for (size_t k = 0; k < script.size(); k++)
            if (script[k][0] == "finally") last_resort = k + 1;
    }
    uint64_t number(size_t k) const { return std::stoull(script[at][k]); }
    void answer(uint64_t value, uint32_t response = 0) {
        if (at < script.size())
            std::fprintf(report, "%zu %llu %llu %u\n", at, (unsigned long long)cycle,
                         (unsigned long long)value, response);
        if (live && at < script.size()) {
            std::printf("answer %llu %u\n", (unsigned long long)value, response);
            std::fflush(stdout);
        }
        doing = nothing;
    }
    // After a failure only the script's last part runs; a failure in it ends the script.
    void fail(const char* why) {
        over = next >= last_resort || lite.busy();
        if (result == "done") result = why;
        next = std::max(next, last_resort);
        doing = nothing;
    }
    void begin() {
        std::string text;
        if (next == script.size() && live && std::getline(std::cin, text))
            script.push_back(words(text));
        if (next == script.size()) { over = true; return; }
        at = next++;
        const std::string& command = script[at][0];
        if (command == "write") { lite.write(number(1), number(2)); doing = access; }
        else if (command == "read") { lite.read(number(1)); doing = access; }
        else if (command == "wait") { mask = number(1); doing = waiting; wait(); }
        else if (command == "cycles") { left = number(1); doing = counting; }
        else if (command == "reset") { left = number(1); doing = resetting; forget(); }
        else if (command == "save") { save(); answer(0); }
    }
    void forget() { pending = finished = ended = 0; }
    void save() {  // address, bytes, name of the file
        FILE* file = std::fopen((settings.folder + "/" + script[at][3]).c_str(), "wb");
        const Region* region = memory.holds(number(1), number(2));
        if (region) std::fwrite(memory.place(*region, number(1)), 1, number(2), file);
        std::fclose(file);
    }
    void wait() {
        if (pending & mask) {
            uint32_t found = pending & mask;
            pending &= ~mask;
            if ((found & INTERRUPT_FRAME) && --ended) pending |= INTERRUPT_FRAME;
            answer(found);
        } else if (pending & INTERRUPT_ERROR) {
            fail("error");
        } else if (INTERRUPT) {
            lite.read(interrupt_register);
            doing = asking;
        }
    }
    void drive() {
        if (doing == waiting) wait();
        while (doing == nothing && !over) begin();
        top.rst = doing == resetting && left > 1;  // the machine takes it a cycle later
        if (doing == resetting) { lite.forget(); memory.forget(); } else lite.drive();
    }
    void clock() {
        moved = doing == counting || doing == resetting || lite.moved;
        if (INTERRUPT && !raised) rose = cycle;
        raised = INTERRUPT;
        cycle++;
        if (doing == resetting || doing == counting) {
            if (--left == 0) answer(0);
            return;
        }
        lite.clock();
        moved |= lite.moved;
        if (lite.busy() || !lite.moved) return;
        if (doing == access) {
            answer(lite.value, lite.response);
        } else if (doing == asking) {
            asked = rose, seen = lite.value;
            if (uint32_t others = seen & ~INTERRUPT_FRAME) happened(asked, others);
            pending |= seen & ~INTERRUPT_FRAME;
            lite.write(interrupt_register, seen);
            doing = clearing;
        } else if (doing == clearing && seen & INTERRUPT_FRAME) {
            lite.read(finished_register);
            doing = ending;
        } else if (doing == clearing) {
            go_on();
        } else if (doing == ending) {
            for (; finished != uint16_t(lite.value); finished++, ended++, asked = cycle)
                happened(asked, INTERRUPT_FRAME);
            if (ended) pending |= INTERRUPT_FRAME;
            go_on();
        }
    }
    void happened(uint64_t when, uint32_t bits) {
        std::fprintf(report, "event %llu %u\n", (unsigned long long)when, bits);
    }
    void go_on() {
        rose = cycle;  // for an interrupt that rose meanwhile
        doing = waiting;
    }
};
