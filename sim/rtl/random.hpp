// Random numbers and random stalls.

#pragma once

#include <cstdint>

struct Random {  // splitmix64
    uint64_t state;
    uint64_t operator()() {
        uint64_t z = state += 0x9e3779b97f4a7c15;
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
        z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
        return z ^ (z >> 31);
    }
};

// Idle cycles of one side of a stream: an average share of `share`, in phases of 1 to 128 cycles.
// In half of the phases each cycle is drawn, the others are idle or busy as a whole.
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
