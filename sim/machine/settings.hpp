// Settings and script of a run: files of lines, which are split into words.

#pragma once

#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "random.hpp"

using Line = std::vector<std::string>;

inline Line words(const std::string& text) {
    std::istringstream given(text);
    Line line;
    for (std::string word; given >> word;) line.push_back(word);
    return line;
}

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
            Line line = words(text);
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
