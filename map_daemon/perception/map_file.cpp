#include "map_daemon/perception/map_file.h"

#include <spdlog/spdlog.h>

#include <stdexcept>
#include <string>
#include <utility>

#include "lcmtypes/bus/atomic_file.h"
#include "map_daemon/octomap_file.h"

namespace swarm {

KeptMap MapFile::read(double resolution_m) const {
  if (path_.extension() != ".bt") throw std::runtime_error("'" + path_.string() + "': a map is kept in a .bt file");
  if (!std::filesystem::exists(path_)) {
    const std::filesystem::path directory = path_.has_parent_path() ? path_.parent_path() : ".";
    if (!std::filesystem::is_directory(directory))
      throw std::runtime_error("'" + path_.string() + "' cannot be written: there is no directory " +
                               directory.string());
    return KeptMap(resolution_m);
  }
  return {*read_octomap(path_.string()), path_.string(), resolution_m};
}

bool MapFile::begin_writing(KeptMap map) {
  if (is_writing_.exchange(true)) return false;
  has_failed_ = false;
  writer_ = std::jthread([this, map = std::move(map)] { write(map), is_writing_ = false; });
  return true;
}

void MapFile::write(const KeptMap& map) {
  try {
    write_file(path_, map.to_octomap());
    has_failed_ = false;
    ++written_;
    spdlog::info("wrote {}", path_.string());
  } catch (const std::exception& error) {
    has_failed_ = true;
    spdlog::error("the map is not written: {}", error.what());
  }
}

}  // namespace swarm
