"""What `sim.rtl.streams` compiles around a component: the C++ main, and the build that is kept.

The main knows streams by four kinds of ports: a source drives a stream into the component, a sink
takes one out of it, a driven port gets rows cycle by cycle (the last one stays), a sampled port is
written down in every cycle. Rows are bytes, little-endian, as `spec.record` packs them.
"""

import fcntl
import hashlib
import json
import os
import shutil
import subprocess
from functools import partial
from pathlib import Path

from splatcore.sim.rtl.verilator import environment

BUILD = Path("build") / "streams"
"""Where compiled simulations are kept, by the hash of what they were made from."""

ARGS = [
    "--cc", "--exe", "--build", "--build-jobs", "2", "-O3", "--x-assign", "fast", "-Wno-fatal",
    "--assert", "--output-split", "5000", "--top-module", "top", "-Mdir", "obj",
]  # fmt: skip

TAIL = 64
"""Cycles that a run goes on after its last row, in which nothing more may come."""

LOG_LINES = 40

MAIN = r"""
#include "Vtop.h"
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <tuple>

using Bytes = std::vector<uint8_t>;

struct Random {  // splitmix64
    uint64_t state;
    uint64_t operator()() {
        uint64_t z = state += 0x9e3779b97f4a7c15;
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
        z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
        return z ^ (z >> 31);
    }
};

// When one side of one stream does nothing: with probability `share` on the average, in phases of
// 1 to 128 cycles: half of them draw in every cycle, the others are idle or busy as a whole.
struct Stall {
    Random random;
    double share;
    int left = 0, kind = 0;
    bool draw() { return double(random() >> 11) < share * double(1ull << 53); }
    bool idle() {
        if (share == 0) return false;
        if (left == 0) {
            left = 1 + random() % (1ull << (random() % 8));
            kind = random() % 2 ? 0 : draw() ? 1 : 2;
        }
        left--;
        return kind == 0 ? draw() : kind == 1;
    }
};

struct Settings {
    std::string folder;
    uint64_t cycles_max, idle_max, seed;
    double stall;
    bool patient;  // no number of rows is known: wait until nothing moves
    uint64_t streams = 0;
    Random random() { return Random{Random{Random{seed}() ^ ++streams}()}; }
};

Bytes load(const Settings& settings, const std::string& name) {
    FILE* file = std::fopen((settings.folder + "/" + name).c_str(), "rb");
    if (!file) { std::perror(name.c_str()); std::exit(2); }
    std::fseek(file, 0, SEEK_END);
    Bytes rows(std::ftell(file));
    std::rewind(file);
    if (std::fread(rows.data(), 1, rows.size(), file) != rows.size()) std::exit(2);
    std::fclose(file);
    return rows;
}

void save(const Settings& settings, const std::string& name, const Bytes& rows) {
    FILE* file = std::fopen((settings.folder + "/" + name).c_str(), "wb");
    if (!file) { std::perror(name.c_str()); std::exit(2); }
    if (std::fwrite(rows.data(), 1, rows.size(), file) != rows.size()) std::exit(2);
    std::fclose(file);
}

// A port is an integer or an array of words: in both cases little-endian bytes, zero above.
template <class Port> void put(Port& port, const uint8_t* row, size_t size) {
    if (size < sizeof(port)) std::memset(static_cast<void*>(&port), 0, sizeof(port));
    std::memcpy(static_cast<void*>(&port), row, size);
}

template <class Port> void append(Bytes& rows, const Port& port, size_t size) {
    const uint8_t* from = reinterpret_cast<const uint8_t*>(&port);
    rows.insert(rows.end(), from, from + size);
}

template <class Port> struct Source {
    const char* name;
    Port& payload;
    CData& valid;
    const CData& ready;
    int width;
    Bytes rows;
    Stall stall;
    Random noise;
    size_t size, count, next = 0;
    bool offered = false;
    bool first;  // the others begin when it is through
    Source(Settings& s, const char* name, Port& payload, CData& valid, const CData& ready,
           int width)
        : name(name), payload(payload), valid(valid), ready(ready), width(width),
          rows(load(s, name)), stall{s.random(), s.stall}, noise{s.random()},
          size((width + 7) / 8), count(rows.size() / size),
          first(Verilated::commandArgsPlusMatch(("first:" + std::string(name) + ":").c_str())[0]) {}
    bool pending() const { return next < count; }
    void drive(bool begun) {
        if (!offered) {
            offered = pending() && (first || begun) && !stall.idle();
            if (offered) put(payload, &rows[next * size], size); else scramble();
        }
        valid = offered;
    }
    void scramble() {  // a component that looks at a payload that is not valid is found out
        uint8_t row[(sizeof(Port) + 7) / 8 * 8];
        for (size_t k = 0; k < size; k += 8) {
            uint64_t word = noise();
            std::memcpy(row + k, &word, 8);
        }
        if (width % 8) row[size - 1] &= (1 << width % 8) - 1;
        put(payload, row, size);
    }
    bool clock() {
        if (!(offered && ready)) return false;
        offered = false;
        next++;
        return true;
    }
};

template <class Port> struct Sink {
    const char* name;
    const Port& payload;
    const CData& valid;
    CData& ready;
    size_t size;
    int64_t expected;  // -1: not known
    Bytes rows;
    Stall stall;
    int64_t taken = 0;
    bool waiting = false;
    Port held;
    Sink(Settings& s, const char* name, const Port& payload, const CData& valid, CData& ready,
         int width, int64_t expected)
        : name(name), payload(payload), valid(valid), ready(ready), size((width + 7) / 8),
          expected(expected), stall{s.random(), s.stall} {}
    bool pending() const { return taken < expected; }
    void drive(bool eager) { ready = eager || !stall.idle(); }
    const char* broken() const {
        if (!waiting) return nullptr;
        if (!valid) return "valid fell";
        return std::memcmp(&payload, &held, sizeof(held)) ? "the payload changed" : nullptr;
    }
    // 0: nothing passed; 1: a row that nobody counts on; 2: one that was waited for.
    int clock() {
        waiting = valid && !ready;
        if (waiting) std::memcpy(static_cast<void*>(&held), &payload, sizeof(held));
        if (!(valid && ready)) return 0;
        append(rows, payload, size);
        taken++;
        return taken <= expected || expected < 0 ? 2 : 1;
    }
};

template <class Port> struct Driven {
    Port& port;
    Bytes rows;
    size_t size, next = 0;
    Driven(Settings& s, const char* name, Port& port, int width)
        : port(port), rows(load(s, name)), size((width + 7) / 8) { drive(); next = 0; }
    bool pending() const { return next * size < rows.size(); }
    bool drive() {
        if (!pending()) return false;
        put(port, &rows[next++ * size], size);
        return true;
    }
};

template <class Port> struct Sampled {
    const char* name;
    const Port& port;
    size_t size;
    bool always;  // or only at the end
    Bytes rows;
    Sampled(const char* name, const Port& port, int width, bool always)
        : name(name), port(port), size((width + 7) / 8), always(always) {}
    void sample() { append(rows, port, size); }
};

int main(int argc, char** argv) {
    Verilated::commandArgs(argc, argv);
    Settings settings{argv[1], std::strtoull(argv[2], 0, 10), std::strtoull(argv[3], 0, 10),
                      std::strtoull(argv[4], 0, 10), std::strtod(argv[5], 0), argv[6][0] == '1'};
    [[maybe_unused]] char** expected = argv + 7;
    Vtop top;
    std::tuple sources{@SOURCES@};
    std::tuple sinks{@SINKS@};
    std::tuple driven{@DRIVEN@};
    std::tuple sampled{@SAMPLED@};
    auto each = [](auto& ports, auto work) {
        std::apply([&](auto&... port) { (work(port), ...); }, ports);
    };
    auto rise = [&] { @RISE@ };
    auto fall = [&] { @FALL@ };
    @RESET@
    for (int k = 0; k < 2; k++) { fall(); rise(); }
    @RUN@

    const char* why = "limit";
    std::string rule;
    uint64_t cycle = 0, last = 0, idle = 0, tail = 0;
    while (cycle < settings.cycles_max) {
        bool waits = false, left = false, moved = false, begun = true;
        each(sinks, [&](auto& sink) { waits |= sink.pending(); });
        each(sources, [&](auto& source) { left |= source.pending(); });
        each(driven, [&](auto& port) { left |= port.pending(); });
        tail = settings.patient || waits || left ? 0 : tail + 1;
        each(driven, [&](auto& port) { moved |= port.drive(); });
        each(sources, [&](auto& source) { begun &= !(source.first && source.pending()); });
        each(sources, [&](auto& source) { source.drive(begun); });
        each(sinks, [&](auto& sink) { sink.drive(tail > 0); });
        fall();
        each(sampled, [&](auto& port) { if (port.always) port.sample(); });
        each(sinks, [&](auto& sink) {
            if (sink.broken()) rule = std::string(sink.name) + " " + sink.broken();
        });
        if (!rule.empty()) { why = "rule"; break; }
        each(sources, [&](auto& source) { moved |= source.clock(); });
        cycle++;
        each(sinks, [&](auto& sink) {
            if (sink.clock() == 2) { moved = true; last = cycle; }
        });
        rise();
        idle = moved ? 0 : idle + 1;
        if (tail == @TAIL@) { why = "done"; break; }
        if (idle == settings.idle_max) { why = "idle"; break; }
    }
    fall();
    each(sampled, [&](auto& port) {
        if (!port.always) port.sample();
        save(settings, port.name, port.rows);
    });
    each(sinks, [&](auto& sink) { save(settings, sink.name, sink.rows); });
    std::printf("%s\n%llu\n%llu\n%s\n", why, (unsigned long long)cycle, (unsigned long long)last,
                rule.c_str());
    each(sources, [&](auto& source) { std::printf("%zu\n", source.next); });
    top.final();
}
"""


def build(source: str, main: str, more: tuple[str, ...] = ()) -> Path:
    """The program of a Verilog module `top` and a C++ main; more: arguments for Verilator."""
    args = [*ARGS, *more]
    made_from = json.dumps([source, main, args])
    folder = (BUILD / _digest(made_from)).absolute()
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # another process may be at the same build
        if not (folder / "built").exists():
            (folder / "top.sv").write_text(source)
            (folder / "main.cpp").write_text(main)
            _compile(folder, args)
            (folder / "built").touch()
    return folder / "obj" / "Vtop"


def _compile(folder: Path, args: list[str]) -> None:
    """Run Verilator and the C++ compiler in a folder; RuntimeError with the end of their log.

    Most of the time would go into Verilator's own library, the same for all: it is compiled once.
    """
    variables = environment()
    run = partial(subprocess.run, env=variables, capture_output=True, text=True, check=False)
    program = shutil.which("verilator", path=variables["PATH"])
    version = run([program, "--version"]).stdout
    made_from = json.dumps([program, version, variables.get("MAKEFLAGS"), args])
    library, objects = folder.parent / f"library-{_digest(made_from)}", folder / "obj"
    for made in (library, objects):
        made.mkdir(exist_ok=True)
    _copy(library, objects)
    there = [f"-o {file.name}" for file in objects.glob("verilated*.o")]
    flags = " ".join(["OPT_FAST=-O2", *there])
    done = run([program, *args, "-MAKEFLAGS", flags, "top.sv", "main.cpp"], cwd=folder)
    if done.returncode:
        log = (done.stdout + done.stderr).splitlines()[-LOG_LINES:]
        raise RuntimeError("\n".join([f"Verilator or g++ failed in {folder}", *log]))
    _copy(objects, library)


def _copy(source: Path, target: Path) -> None:
    """Copy what is compiled of the library."""
    for file in source.glob("verilated*.o"):
        if not (target / file.name).exists():
            scratch = target / f"{file.name}.{os.getpid()}"  # others may be copying it too
            shutil.copy(file, scratch)
            scratch.replace(target / file.name)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
