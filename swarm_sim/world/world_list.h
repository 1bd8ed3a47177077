// Many worlds at one place: a file with one world's JSON a line, plain (.jsonl) or compressed (.jsonl.gz), or a
// directory of world files (.json).
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "swarm_sim/world/world.h"

namespace swarm {

// The lines that are not empty, or the files in the order of their names. Throws WorldError where there are none, or
// one cannot be read.
struct ListedWorld {
  std::string place;  // FILE.jsonl:N, from 1, or DIRECTORY/FILE.json
  std::string text;
};
std::vector<ListedWorld> read_listed_worlds(const std::filesystem::path& path);

// The world of a file, or of line N of a list when `place` is "FILE.jsonl:N" or "FILE.jsonl.gz:N". Throws WorldError.
World read_listed_world(const std::string& place);

}  // namespace swarm
