#include "swarm_sim/world/world_list.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <memory>

#include "swarm_sim/world/world_json.h"

namespace swarm {
namespace {

std::string unpack(const std::filesystem::path& path) {
  constexpr std::size_t kMaxBytes = std::size_t{1} << 30;
  std::error_code ignored;
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> in(
      std::filesystem::is_directory(path, ignored) ? nullptr : gzopen(path.c_str(), "rb"), gzclose);
  if (!in) throw WorldError(path.string() + ": must be a readable list of worlds");
  std::string text;
  std::array<char, 1 << 16> buffer;
  for (int n = 0; (n = gzread(in.get(), buffer.data(), buffer.size())) != 0;) {
    if (n < 0) throw WorldError(path.string() + ": must be plain text or a whole gzip file");
    text.append(buffer.data(), static_cast<std::size_t>(n));
    if (text.size() > kMaxBytes) throw WorldError(path.string() + ": must be at most 1 GiB of text");
  }
  int error = Z_OK;
  (void)gzerror(in.get(), &error);
  if (error != Z_OK) throw WorldError(path.string() + ": must be plain text or a whole gzip file");
  return text;
}

std::vector<ListedWorld> read_directory(const std::filesystem::path& directory) {
  std::vector<std::filesystem::path> paths;
  for (const auto& entry : std::filesystem::directory_iterator(directory)) {
    if (entry.path().extension() == ".json") paths.push_back(entry.path());
  }
  std::ranges::sort(paths);
  std::vector<ListedWorld> worlds;
  worlds.reserve(paths.size());
  for (const auto& path : paths) worlds.push_back({path.string(), unpack(path)});
  if (worlds.empty()) throw WorldError(directory.string() + ": must hold at least one world file (.json)");
  return worlds;
}

}  // namespace

std::vector<ListedWorld> read_listed_worlds(const std::filesystem::path& path) {
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) return read_directory(path);
  const std::string text = unpack(path);
  std::vector<ListedWorld> lines;
  int number = 1;
  for (std::size_t begin = 0; begin < text.size(); ++number) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    std::string line = text.substr(begin, end - begin);
    if (line.find_first_not_of(" \t\r") != std::string::npos)
      lines.push_back({path.string() + ":" + std::to_string(number), std::move(line)});
    begin = end + 1;
  }
  if (lines.empty()) throw WorldError(path.string() + ": must hold at least one world");
  return lines;
}

World read_listed_world(const std::string& place) {
  const std::size_t colon = place.rfind(':');
  if (colon == std::string::npos) return read_world(place);
  const std::string list = place.substr(0, colon), number = place.substr(colon + 1);
  const bool listed = list.ends_with(".jsonl") || list.ends_with(".jsonl.gz");
  if (!listed || number.empty() || number.size() > 9 || number.find_first_not_of("0123456789") != std::string::npos)
    return read_world(place);
  const std::filesystem::path path = list;
  const std::string wanted = path.string() + ":" + std::to_string(std::stoi(number));
  for (const ListedWorld& world : read_listed_worlds(path)) {
    if (world.place == wanted) return parse_world(world.text, place, path.parent_path());
  }
  throw WorldError(list + ": line " + number + ": must hold a world");
}

}  // namespace swarm
