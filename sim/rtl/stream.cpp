// Drives the streams and ports of a component, for sim/rtl/streams.py. Arguments: the folder of
// input and output rows, limits, a seed and the expected numbers of rows.
//
// A source drives an input stream, a sink accepts an output stream, a driven port gets one row per
// cycle (the last one stays), a sampled port is recorded in every cycle. Rows are bytes,
// little-endian, as packed by spec/record.py. `ports.hpp` is generated for each component.

#include <cstdint>
#include <cstdio>
#include <cstring>
#include <string>
#include <tuple>
#include <vector>

#include "Vtop.h"
#include "coverage.hpp"
#include "ports.hpp"
#include "random.hpp"

#define STREAM(name) top.name##___05Fpayload, top.name##___05Fvalid, top.name##___05Fready
#define SOURCE(title, name, width) Source(settings, title, STREAM(name), width)
#define SINK(title, name, width) Sink(settings, title, STREAM(name), width, std::atoll(*expected++))
#define DRIVEN(title, name, width) Driven(settings, title, top.name, width)
#define SAMPLE(title, name, width) Sampled("sample." title, top.name, width, true)
#define END(title, name, width) Sampled("end." title, top.name, width, false)

using Bytes = std::vector<uint8_t>;

struct Settings {
    std::string folder;
    uint64_t cycles_max, idle_max, seed;
    double stall;
    bool patient;  // no expected number of rows: run until nothing moves
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
    bool first;  // the other sources wait until it is done
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
    void scramble() {  // random, to detect a component that uses an invalid payload
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
    int64_t expected;  // -1: unknown
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
    // 0: no transfer; 1: an unexpected row; 2: an expected row.
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
    bool always;  // else only at the end
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
    std::tuple sources{SOURCES};
    std::tuple sinks{SINKS};
    std::tuple driven{DRIVEN_PORTS};
    std::tuple sampled{SAMPLED_PORTS};
    auto each = [](auto& ports, auto work) {
        std::apply([&](auto&... port) { (work(port), ...); }, ports);
    };
    auto rise = [&] {
#if HAS_CLOCK
        top.clk = 1;
        top.eval();
#endif
    };
    auto fall = [&] {
#if HAS_CLOCK
        top.clk = 0;
#endif
        top.eval();
    };
    auto reset = [&]([[maybe_unused]] bool active) {
#if HAS_RESET
        top.rst = active;
#endif
    };
    reset(true);
    for (int k = 0; k < 2; k++) { fall(); rise(); }
    reset(false);

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
        if (tail == TAIL) { why = "done"; break; }
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
    keep_coverage(argv[0]);
}
