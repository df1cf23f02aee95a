// The memory on the machine's AXI4 master: accessible regions anywhere in the address space, whose
// bytes are stored in a memory-mapped file. Accesses outside of them, and writes to read-only
// regions, are answered by a decode error and counted. Reads and writes have separate paths and
// share the bandwidth; all answers come in the order of their requests.
//
// A read returns the contents at its request, and a write takes effect with its answer: a machine
// that relies on more gives wrong results here. A violation of AXI's rules ends the run: an offer
// that is withdrawn or changed, a burst of partial beats, a burst across a boundary, or a WLAST
// that is not at a burst's last beat.
//
// Timing: `latency` cycles from accepting a request to its first beat, and from a burst's last beat
// to its answer; at most `outstanding` requests of a path are in flight. `bandwidth` is in bytes
// per cycle (0: unlimited); an access takes a whole `granule` for each one that it touches. With
// `stall` each channel idles with that probability, in phases.

#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <deque>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "Vtop.h"
#include "config.hpp"
#include "random.hpp"
#include "settings.hpp"

#define AXI(signal) top.m_axi___05F##signal

constexpr uint32_t WHOLE = (uint64_t(1) << BEAT) - 1, INCREASING = 1;
constexpr uint8_t OKAY = 0, SLAVE_ERROR = 2, DECODE_ERROR = 3;
constexpr size_t BEATS_WAITING = 32;  // written beats that wait for their request or for bandwidth
constexpr size_t OUTSIDE_SHOWN = 8;
constexpr uint32_t UNUSED_ID = (1 << ID_BITS) - 1;  // no reader and no writer has it

struct Region {
    std::string name;
    uint64_t begin, end;
    bool writable;
    uint64_t at;  // in the array
    uint64_t read = 0, written = 0;  // bytes
};

struct Request {
    uint32_t id = 0;
    uint64_t address = 0;
    uint32_t length = 0, size = 0, burst = 0;
    uint64_t bytes() const { return uint64_t(length + 1) << size; }
    bool operator==(const Request& other) const {
        return id == other.id && address == other.address && length == other.length &&
               size == other.size && burst == other.burst;
    }
};

struct ReadBeat {
    uint64_t due;
    uint32_t id;
    uint8_t response;
    bool last, costs;
    uint8_t data[BEAT];
};

struct WriteBeat {
    uint32_t strobe;
    bool last;
    uint8_t data[BEAT];
    bool operator==(const WriteBeat& other) const {
        return strobe == other.strobe && last == other.last &&
               !std::memcmp(data, other.data, BEAT);
    }
};

struct Burst {
    Request request;
    uint8_t response;
    Region* region;
    uint64_t due = 0;
    std::vector<WriteBeat> beats;
};

// An offer of the machine that was not accepted: it must not change.
template <class Item> struct Held {
    bool waiting = false;
    Item item;
    bool broken(bool valid, const Item& now) { return waiting && !(valid && now == item); }
    void clock(bool valid, bool ready, const Item& now) {
        waiting = valid && !ready;
        if (waiting) item = now;
    }
};

// Injected faults: the numbers, from 0, of the beats or bursts that go wrong.
struct Failing {
    std::set<uint64_t> numbers;
    uint64_t count = 0;
    bool next() { return numbers.count(count++); }
};

struct Memory {
    Vtop& top;
    uint8_t* data;
    uint64_t latency, granule;
    double bandwidth, tokens = 0;
    size_t outstanding;
    std::vector<Region> regions;
    Failing read_errors, write_errors, read_strays, write_strays, read_missing, write_missing;
    Stall ar, r, aw, w, b;
    Random noise;
    bool scrambled, turn = false, moved = false, reading = false, answering = false;
    uint64_t cycle = 0, image_bytes = 0, outside = 0, reads_inside = 0;
    std::deque<ReadBeat> read_beats;
    std::deque<Burst> bursts, answers;
    std::deque<WriteBeat> write_beats;
    Held<Request> ar_held, aw_held;
    Held<WriteBeat> w_held;
    std::map<uint32_t, uint64_t> beats_read, beats_written;
    std::vector<std::string> outside_shown;
    std::string rule;
    std::function<void(uint64_t, uint64_t)> on_read;    // address, bytes
    std::function<void(uint64_t, uint32_t)> on_write;   // address, strobe

    Memory(Vtop& top, Settings& s, uint8_t* data)
        : top(top), data(data), latency(s.number("latency")), granule(s.number("granule")),
          bandwidth(s.real("bandwidth")),
          outstanding(s.number("outstanding")), ar(s.stall()), r(s.stall()), aw(s.stall()),
          w(s.stall()), b(s.stall()), noise(s.random()), scrambled(s.real("stall") > 0) {
        auto number = [](const std::string& text) { return std::stoull(text); };
        for (auto& line : s.all("region"))
            regions.push_back({line[0], number(line[1]), number(line[2]), line[3] == "1",
                               number(line[4])});
        const std::pair<const char*, Failing*> kinds[] = {
            {"read_errors", &read_errors},   {"write_errors", &write_errors},
            {"read_strays", &read_strays},   {"write_strays", &write_strays},
            {"read_missing", &read_missing}, {"write_missing", &write_missing}};
        for (auto& [name, failing] : kinds)
            for (auto& line : s.all(name)) failing->numbers.insert(number(line[0]));
    }
    void forget() {
        read_beats.clear(), bursts.clear(), answers.clear(), write_beats.clear();
        reading = answering = ar_held.waiting = aw_held.waiting = w_held.waiting = false;
        reads_inside = 0;
        AXI(rvalid) = AXI(bvalid) = AXI(arready) = AXI(awready) = AXI(wready) = 0;
    }
    bool costs(uint64_t address, bool first) {
        return bandwidth && (first || !granule || address % granule == 0);
    }
    bool afford(bool costs) {
        double price = granule > BEAT ? granule : BEAT;
        if (!costs || tokens >= price) {
            tokens -= costs ? price : 0;
            return true;
        }
        return false;
    }
    uint8_t* place(const Region& region, uint64_t address) {
        return data + region.at + (address - region.begin);
    }
    Region* holds(uint64_t address, uint64_t bytes) {
        for (auto& region : regions)
            if (region.begin <= address && address + bytes <= region.end) return &region;
        return nullptr;
    }
    Region* find(const Request& request, bool write) {
        Region* found = holds(request.address, request.bytes());
        if (found && (found->writable || !write)) return found;
        outside++;
        if (outside_shown.size() < OUTSIDE_SHOWN)
            outside_shown.push_back(std::string(write ? "write " : "read ") +
                                    std::to_string(request.id) + " " +
                                    std::to_string(request.address) + " " +
                                    std::to_string(request.bytes()) + " " + std::to_string(cycle));
        return nullptr;
    }
    void break_rule(const char* what) {
        if (rule.empty()) rule = what;
    }
    void check(const Request& request) {
        bool narrow = request.size < BEAT_BITS && request.length == 0;
        if (!narrow && request.size != BEAT_BITS || request.burst != INCREASING ||
            request.address % (1 << request.size))
            break_rule("a burst is neither whole beats nor a part of one beat");
        if (request.address % BOUNDARY + request.bytes() > BOUNDARY)
            break_rule("a burst crosses a boundary");
    }

    void drive() {
        double most = std::max(bandwidth, 2.0 * std::max(granule, BEAT));
        tokens = std::min(tokens + bandwidth, most);
        turn = !turn;
        if (turn) { offer_read(); perform(); } else { perform(); offer_read(); }
        if (!answering)
            answering = !answers.empty() && answers.front().due <= cycle && !b.idle();
        AXI(bvalid) = answering;
        if (answering) {
            AXI(bid) = answers.front().request.id;
            AXI(bresp) = answers.front().response;
        }
        AXI(arready) = reads_inside < outstanding && !ar.idle();
        AXI(awready) = bursts.size() + answers.size() < outstanding && !aw.idle();
        AXI(wready) = write_beats.size() < BEATS_WAITING && !w.idle();
    }
    void offer_read() {
        if (!reading && !read_beats.empty() && read_beats.front().due <= cycle && !r.idle() &&
            afford(read_beats.front().costs)) {
            const ReadBeat& beat = read_beats.front();
            reading = true;
            std::memcpy(&AXI(rdata), beat.data, BEAT);
            AXI(rid) = beat.id;
            AXI(rresp) = beat.response;
            AXI(rlast) = beat.last;
        } else if (!reading && scrambled) {
            uint64_t words[BEAT / 8];
            for (auto& word : words) word = noise();
            std::memcpy(&AXI(rdata), words, BEAT);
        }
        AXI(rvalid) = reading;
    }
    void perform() {  // at most one written beat, if its request has arrived
        if (write_beats.empty() || bursts.empty()) return;
        Burst& burst = bursts.front();
        uint64_t address = burst.request.address + burst.beats.size() * BEAT;
        if (!afford(costs(address, burst.beats.empty()))) return;
        const WriteBeat& beat = write_beats.front();
        bool last = burst.beats.size() == burst.request.length;
        if (beat.last != last) break_rule("WLAST is not at a burst's last beat");
        if (burst.region) {
            uint64_t bytes = __builtin_popcount(beat.strobe);
            burst.region->written += bytes;
            if (burst.region->name.rfind("image", 0) == 0) image_bytes += bytes;
        }
        if (on_write) on_write(address, beat.strobe);
        beats_written[burst.request.id]++;
        burst.beats.push_back(beat);
        write_beats.pop_front();
        if (!last) return;
        burst.due = cycle + latency;
        if (write_strays.next()) answers.push_back({{UNUSED_ID}, SLAVE_ERROR, nullptr, burst.due, {}});
        if (!write_missing.next()) answers.push_back(std::move(burst));
        bursts.pop_front();
    }

    void clock() {
        moved = false;
        if (AXI(rvalid) && AXI(rready)) {
            moved = true, reading = false;
            reads_inside -= read_beats.front().last;
            read_beats.pop_front();
        }
        if (AXI(bvalid) && AXI(bready)) {
            moved = true, answering = false;
            store(answers.front());
            answers.pop_front();
        }
        Request read{AXI(arid), AXI(araddr), AXI(arlen), AXI(arsize), AXI(arburst)};
        Request write{AXI(awid), AXI(awaddr), AXI(awlen), AXI(awsize), AXI(awburst)};
        WriteBeat beat{AXI(wstrb), bool(AXI(wlast)), {}};
        std::memcpy(beat.data, &AXI(wdata), BEAT);
        if (ar_held.broken(AXI(arvalid), read)) break_rule("AR was not kept");
        if (aw_held.broken(AXI(awvalid), write)) break_rule("AW was not kept");
        if (w_held.broken(AXI(wvalid), beat)) break_rule("W was not kept");
        ar_held.clock(AXI(arvalid), AXI(arready), read);
        aw_held.clock(AXI(awvalid), AXI(awready), write);
        w_held.clock(AXI(wvalid), AXI(wready), beat);
        if (AXI(arvalid) && AXI(arready)) { moved = true; ask(read); }
        if (AXI(awvalid) && AXI(awready)) {
            moved = true;
            check(write);
            Region* region = find(write, true);
            uint8_t response = !region ? DECODE_ERROR : write_errors.next() ? SLAVE_ERROR : OKAY;
            bursts.push_back({write, response, region});
        }
        if (AXI(wvalid) && AXI(wready)) { moved = true; write_beats.push_back(beat); }
        cycle++;
    }
    void ask(const Request& request) {
        check(request);
        Region* region = find(request, false);
        if (on_read) on_read(request.address, request.bytes());
        for (uint32_t k = 0; k <= request.length; k++) {
            uint64_t address = request.address / BEAT * BEAT + k * BEAT;
            ReadBeat beat{cycle + latency, request.id, OKAY, k == request.length,
                          costs(address, k == 0), {}};
            if (read_strays.next())
                read_beats.push_back({beat.due, UNUSED_ID, SLAVE_ERROR, false, false, {}});
            if (read_errors.next()) beat.response = SLAVE_ERROR;
            if (read_missing.next()) continue;
            if (!region) beat.response = DECODE_ERROR;
            for (uint64_t word = 0; word < BEAT; word += 8) {
                uint64_t value = beat.response == OKAY && request.size == BEAT_BITS ? 0 : noise();
                std::memcpy(beat.data + word, &value, 8);
            }
            if (beat.response == OKAY) {  // of a partial beat only the part that was requested
                uint64_t lane = request.address % BEAT, bytes = std::min(request.bytes(), BEAT);
                std::memcpy(beat.data + lane, place(*region, address + lane), bytes);
            }
            read_beats.push_back(beat);
        }
        reads_inside++;
        beats_read[request.id] += request.length + 1;
        if (region) region->read += request.bytes();
    }
    void store(const Burst& burst) {
        if (burst.response != OKAY) return;
        uint8_t* bytes = place(*burst.region, burst.request.address);
        for (const WriteBeat& beat : burst.beats) {
            if (beat.strobe == WHOLE) std::memcpy(bytes, beat.data, BEAT);
            else
                for (uint64_t k = 0; k < BEAT; k++)
                    if (beat.strobe >> k & 1) bytes[k] = beat.data[k];
            bytes += BEAT;
        }
    }
};
