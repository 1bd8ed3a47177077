// Many worlds in one file: one world's JSON a line, plain (.jsonl) or compressed (.jsonl.gz).
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "swarm_sim/world/world.h"

namespace swarm {

// The lines that are not empty, with their numbers from 1. Throws WorldError where the file cannot be read.
struct WorldLine {
  int number = 0;
  std::string text;
};
std::vector<WorldLine> read_world_lines(const std::filesystem::path& path);

// The world of a file, or of line N of a list when `place` is "FILE.jsonl:N" or "FILE.jsonl.gz:N". Throws WorldError.
World read_listed_world(const std::string& place);

}  // namespace swarm
