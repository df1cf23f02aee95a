"""The C++ program around the Verilated machine: memory, a host that runs a script, a watchdog.

Everything that a run needs lies in a folder: `settings` (a name and its values in each line),
`script` (a command in each line, see `sim.machine.script`) and `memory`, the bytes that the
machine's AXI4 master sees. The program writes `report`, and tells on standard output how far it is.
"""

from pathlib import Path

from splatcore.sim.machine.host import HOST
from splatcore.sim.machine.memory import MEMORY
from splatcore.sim.rtl import build as harness
from splatcore.spec.axi import BEAT, BEAT_BITS, BOUNDARY
from splatcore.spec.registers import INTERRUPT_ERROR

TRACE_ARGS = {
    "vcd": ("--trace", "--trace-depth", "4"),
    "saif": ("--trace-saif", "--trace-max-width", "0", "--no-trace-params"),
}
"""Arguments for Verilator by what is recorded: waveforms of the stages' ports, or how often each
net changes (SAIF)."""

PARTS = r"""
#include "Vtop.h"
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <deque>
#include <fstream>
#include <functional>
#include <map>
#include <set>
#include <sstream>
#include <sys/mman.h>
#include <sys/stat.h>
#include <fcntl.h>
#define TRACE @TRACE@
#if TRACE
#include "verilated_@FORMAT@_c.h"
#endif

@RANDOM@
using Line = std::vector<std::string>;

struct Settings {
    std::string folder;
    std::map<std::string, std::vector<Line>> lines;
    uint64_t streams = 0;
    explicit Settings(const std::string& folder) : folder(folder) {
        for (Line& line : read("settings")) {
            std::string name = line[0];
            line.erase(line.begin());
            lines[name].push_back(line);
        }
    }
    std::vector<Line> read(const std::string& name) const {
        std::ifstream file(folder + "/" + name);
        std::vector<Line> found;
        for (std::string text; std::getline(file, text);) {
            std::istringstream words(text);
            Line line;
            for (std::string word; words >> word;) line.push_back(word);
            if (!line.empty()) found.push_back(line);
        }
        return found;
    }
    const std::vector<Line>& all(const std::string& name) { return lines[name]; }
    uint64_t number(const std::string& name) { return std::stoull(lines.at(name)[0][0]); }
    double real(const std::string& name) { return std::stod(lines.at(name)[0][0]); }
    Random random() { return Random{Random{Random{number("seed")}() ^ ++streams}()}; }
    Stall stall() { return Stall{random(), real("stall")}; }
};
"""

WAVES = r"""
// Writes down a window: given cycles, or from a read of an address until a rectangle's bytes of the
// image have been written.
struct Window {
    VerilatedVcdC vcd;
    uint64_t first = 0, last = UINT64_MAX, image = 0, stride = 1, x0 = 0, x1 = 0, y0 = 0, y1 = 0;
    int64_t left = 0;
    uint64_t begun = UINT64_MAX, ended = UINT64_MAX;
    Window(Vtop& top, Memory& memory, Settings& s) {
        top.trace(&vcd, 99);
        vcd.open((s.folder + "/waves.vcd").c_str());
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
        vcd.dump(10 * cycle + 5 * high);
    }
};
"""

TOGGLES = r"""
// Counts how often each net changes and how long it is 1, at the end of each cycle, when all has
// settled: in windows of so many cycles, of which there is one in every so many. With `steady`,
// bits of the interrupt, from where the first frame's points are ready until its tiles are finished
// and the second one's points are ready: a driver that clears the interrupt tells. The file's
// clock counts the cycles that were looked at.
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
        clears = top.@S@awvalid && top.@S@awaddr == interrupt;
        if (clears && !before) {
            ready += (top.@S@wdata & ready_bit) != 0;
            finished += (top.@S@wdata & frame_bit) != 0;
        }
        if (ready == 0 || (ready > 1 && finished > 0)) return;
        if (start == UINT64_MAX) start = cycle;
        if ((cycle - start) / length % every) return;
        saif.dump(time++);
        if (begun == UINT64_MAX) begun = cycle;
        ended = cycle;
    }
};
"""

MAIN = r"""
#if TRACE@WINDOW@#endif

int main(int argc, char** argv) {
    Verilated::commandArgs(argc, argv);
    Settings settings(argv[1]);
    int file = open((settings.folder + "/memory").c_str(), O_RDWR);
    uint64_t size = settings.number("size");
    void* data = mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (data == MAP_FAILED) { std::perror("memory"); return 2; }
#if TRACE
    Verilated::traceEverOn(true);
#endif
    Vtop top;
    Memory memory(top, settings, static_cast<uint8_t*>(data));
    Host host(top, memory, settings);
#if TRACE
    Window window(top, memory, settings);
#endif
    uint64_t cycle = 0, idle = 0, idle_max = settings.number("idle_max");
    uint64_t cycles_max = settings.number("cycles_max");
    auto told = std::chrono::steady_clock::now();
    std::string rule;
    while (!host.over) {
        memory.drive();
        host.drive();
        if (host.over) break;
        top.clk = 0;
        top.eval();
#if TRACE
        window.dump(cycle, false);
#endif
        bool reset = top.rst;
        if (!reset) memory.clock(); else memory.cycle++;
        host.clock();
        rule = !memory.rule.empty() ? memory.rule : host.lite.rule;
        if (!rule.empty()) { host.result = "rule"; break; }
        idle = memory.moved || host.moved ? 0 : idle + 1;
        if (idle > idle_max) { host.fail("hang"); idle = 0; }
        top.clk = 1;
        top.eval();
#if TRACE
        window.dump(cycle, true);
#endif
        if (++cycle == cycles_max) { host.result = "limit"; break; }
        if (cycle % 4096 == 0) {
            auto now = std::chrono::steady_clock::now();
            if (now - told > std::chrono::milliseconds(500)) {
                told = now;
                std::printf("progress %llu %llu\n", (unsigned long long)cycle,
                            (unsigned long long)memory.image_bytes);
                std::fflush(stdout);
            }
        }
    }
    auto count = [&](const char* what, const std::string& name, uint64_t a, uint64_t b) {
        std::fprintf(host.report, "%s %s %llu %llu\n", what, name.c_str(), (unsigned long long)a,
                     (unsigned long long)b);
    };
    for (auto& [id, beats] : memory.beats_read) count("read", std::to_string(id), beats, 0);
    for (auto& [id, beats] : memory.beats_written) count("written", std::to_string(id), beats, 0);
    for (auto& region : memory.regions) count("region", region.name, region.read, region.written);
    count("outside", "accesses", memory.outside, 0);
    for (auto& text : memory.outside_told) std::fprintf(host.report, "told %s\n", text.c_str());
#if TRACE
    window.@FORMAT@.close();
    if (window.begun != UINT64_MAX) count("window", "cycles", window.begun, window.ended);
#endif
    std::fprintf(host.report, "end %s %llu %zu %s\n", host.result.c_str(),
                 (unsigned long long)cycle, host.at, rule.c_str());
    std::fclose(host.report);
    top.final();
    munmap(data, size);
}
"""


def compiled(source: str, trace: bool = False, toggles: bool = False) -> Path:
    """The program for a machine's Verilog; with `trace` it can write waveforms, with `toggles` it
    counts how often each net changes.
    """
    main = PARTS + MEMORY + HOST + MAIN
    begin = harness.MAIN.index("struct Random")
    for key, text in {
        "RANDOM": harness.MAIN[begin : harness.MAIN.index("struct Settings")],
        "TRACE": str(int(trace or toggles)),
        "WINDOW": TOGGLES if toggles else WAVES,
        "FORMAT": "saif" if toggles else "vcd",
        "M": "m_axi___05F",
        "S": "s_axi___05F",
        "INTERRUPT": "__SYM__interrupt",  # as Verilator calls it, for C++'s sake
        "BEAT": str(BEAT),
        "BEAT_BITS": str(BEAT_BITS),
        "BOUNDARY": str(BOUNDARY),
        "ERROR": str(INTERRUPT_ERROR),
    }.items():
        main = main.replace(f"@{key}@", text)
    more = TRACE_ARGS["saif" if toggles else "vcd"] if trace or toggles else ()
    return harness.build(source, main, more)
