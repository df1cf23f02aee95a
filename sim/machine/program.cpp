// The machine with a memory, a host that runs a script, and a watchdog: see sim/machine/program.py.

#include <fcntl.h>
#include <sys/mman.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <string>

#include "Vtop.h"
#include "config.hpp"
#include "coverage.hpp"
#include "host.hpp"
#include "memory.hpp"
#include "settings.hpp"

#if SAVES
#include "save.hpp"
#endif
#if WAVES
#include "waves.hpp"
#elif TOGGLES
#include "toggles.hpp"
#endif

int main(int argc, char** argv) {
    Verilated::commandArgs(argc, argv);
    Settings settings(argv[1]);
#if WAVES || TOGGLES
    Verilated::traceEverOn(true);
#endif
#if WAVES
    if (!settings.all("names").empty()) {
        Vtop top;
        Waves waves(top, settings);
        waves.dump(0);  // a FST without values is incomplete
        waves.close();
        return 0;
    }
#endif
    int file = open((settings.folder + "/memory").c_str(), O_RDWR);
    uint64_t size = settings.number("size");
    void* data = mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (data == MAP_FAILED) { std::perror("memory"); return 2; }
    Vtop top;
    Memory memory(top, settings, static_cast<uint8_t*>(data));
    Host host(top, memory, settings);
#if WAVES || TOGGLES
    Window window(top, memory, settings);
#endif
    uint64_t cycle = 0, idle = 0, idle_max = settings.number("idle_max");
    uint64_t cycles_max = settings.number("cycles_max");
    auto reported = std::chrono::steady_clock::now();
    std::string rule;
#if SAVES
    uint64_t every = settings.number("save_every"), next_save = 0;
    if (!settings.all("resume").empty()) {
        VerilatedRestore file;
        file.open(settings.folder + "/" + settings.all("resume")[0][0]);
        keep({nullptr, &file}, top, memory, host, size, cycle, idle);
    } else
#endif
    memory.drive();
    while (!host.over) {
#if SAVES
        if (next_save <= cycle) {
            if (next_save) {
                std::string name = "save." + std::to_string(cycle);
                VerilatedSave file;
                file.open(settings.folder + "/" + name);
                keep({&file, nullptr}, top, memory, host, size, cycle, idle);
                file.close();
                std::printf("saved %s\n", name.c_str());
                std::fflush(stdout);
            }
            next_save = every ? (cycle / every + 1) * every : UINT64_MAX;
        }
#endif
        host.drive();
        if (host.over) break;
        top.clk = 0;
        top.eval();
#if WAVES || TOGGLES
        window.dump(cycle, false);
#endif
        if (host.doing != host.resetting) memory.clock(); else memory.cycle++;
        host.clock();
        rule = !memory.rule.empty() ? memory.rule : host.lite.rule;
        if (!rule.empty()) { host.result = "rule"; break; }
        idle = memory.moved || host.moved ? 0 : idle + 1;
        if (idle > idle_max) { host.fail("hang"); idle = 0; }
        memory.drive();  // of the next cycle: the machine takes it at the rising edge
        top.clk = 1;
        top.eval();
#if WAVES || TOGGLES
        window.dump(cycle, true);
#endif
        if (++cycle == cycles_max) { host.result = "limit"; break; }
        if (cycle % 4096 == 0) {
            auto now = std::chrono::steady_clock::now();
            if (now - reported > std::chrono::milliseconds(500)) {
                reported = now;
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
    count("asked", "of", memory.read_errors.count, memory.write_errors.count);
    count("outside", "accesses", memory.outside, 0);
    for (auto& text : memory.outside_shown) std::fprintf(host.report, "shown %s\n", text.c_str());
#if WAVES || TOGGLES
    window.close();
    if (window.begun != UINT64_MAX) count("window", "cycles", window.begun, window.ended);
#endif
    std::fprintf(host.report, "end %s %llu %zu %s\n", host.result.c_str(),
                 (unsigned long long)cycle, host.at, rule.c_str());
    std::fclose(host.report);
    top.final();
    keep_coverage(argv[0]);
    munmap(data, size);
}
