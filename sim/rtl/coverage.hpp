// Saves how often each arm of the Verilog's conditions was taken, if the program was compiled with
// counters (sim/rtl/coverage.py): Verilator's data file, and a file with the name of the program.

#pragma once

#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <string>

#if VM_COVERAGE
#include "verilated_cov.h"
#endif

inline void keep_coverage([[maybe_unused]] const char* program) {
#if VM_COVERAGE
    const char* folder = std::getenv("SPLATCORE_COVERAGE");
    if (!folder) return;
    auto now = std::chrono::steady_clock::now().time_since_epoch().count();
    std::string name = std::string(folder) + "/" + std::to_string(getpid()) + "-" +
                       std::to_string(now);
    VerilatedCov::write(name + ".dat");
    std::ofstream(name + ".program") << program;
#endif
}
