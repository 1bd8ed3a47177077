#include "lcmtypes/bus/cell_channels.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "lcmtypes/bus/channels.h"

namespace swarm {
namespace {

constexpr std::int64_t kMostWide = 2;  // a block, in cells

std::string name_of(const Cell& cell) {
  std::string name = std::to_string(cell.x).append("_").append(std::to_string(cell.y));
  std::ranges::replace(name, '-', 'm');
  return name;
}

std::string channel_of_block(const Cell& low, const Cell& high) {
  std::string name = channel_of(channel::kCellAnnouncement, low);
  if (low == high) return name;
  return name.append("_") + std::to_string(high.x - low.x + 1) + "x" + std::to_string(high.y - low.y + 1);
}

}  // namespace

std::string channel_of(std::string_view kind, const Cell& cell) {
  return std::string(kind).append(kCellPrefix).append(name_of(cell));
}

std::vector<std::string> speaks_on(const std::set<Cell>& cells) {
  if (cells.empty()) return {};
  Cell low = *cells.begin(), high = low;
  for (const Cell& cell : cells) {
    low = {std::min(low.x, cell.x), std::min(low.y, cell.y)};
    high = {std::max(high.x, cell.x), std::max(high.y, cell.y)};
  }
  if (std::max(std::int64_t{high.x} - low.x, std::int64_t{high.y} - low.y) < kMostWide)
    return {channel_of_block(low, high)};
  std::vector<std::string> channels;
  for (const Cell& cell : cells) channels.push_back(channel_of_block(cell, cell));
  return channels;
}

std::set<std::string> heard_on(const std::set<Cell>& cells) {
  std::set<std::string> channels;
  for (const Cell& cell : cells) {
    channels.insert(channel_of(channel::kCellRoster, cell));
    for (const auto& [left, right] : {std::pair(0, 0), std::pair(1, 0), std::pair(0, 1)}) {
      for (const auto& [down, up] : {std::pair(0, 0), std::pair(1, 0), std::pair(0, 1)})
        channels.insert(channel_of_block({cell.x - left, cell.y - down}, {cell.x + right, cell.y + up}));
    }
  }
  return channels;
}

}  // namespace swarm
