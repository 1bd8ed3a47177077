// What is for a cell is heard by who listens for it, and said once where a block holds all.
#include "lcmtypes/bus/cell_channels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "lcmtypes/bus/channels.h"

namespace swarm {
namespace {

TEST(CellChannels, AreNamedByTheirCells) {
  EXPECT_EQ(channel_of(channel::kCellRoster, {-3, 12}), "CELL_ROSTER_at_m3_12");
  EXPECT_EQ(kind_of(channel_of(channel::kCellRoster, {-3, 12})), channel::kCellRoster);
  EXPECT_EQ(speaks_on({{-3, 12}}), std::vector<std::string>{"CELL_ANNOUNCEMENT_at_m3_12"});
  EXPECT_EQ(speaks_on({{-3, 12}, {-2, 11}}), std::vector<std::string>{"CELL_ANNOUNCEMENT_at_m3_11_2x2"});
  EXPECT_EQ(kind_of(speaks_on({{0, 0}, {0, 1}}).front()), channel::kCellAnnouncement);
  EXPECT_EQ(speaks_on({{0, 0}, {0, 2}}),
            (std::vector<std::string>{"CELL_ANNOUNCEMENT_at_0_0", "CELL_ANNOUNCEMENT_at_0_2"}));
  EXPECT_TRUE(speaks_on({}).empty());
  EXPECT_EQ(heard_on({{5, 5}}).size(), 10u);
  constexpr std::int32_t kFar = 1 << 30;
  EXPECT_LE(speaks_on({{-kFar, -kFar}, {1 - kFar, 1 - kFar}}).front().size(), 63u) << "the bus takes no longer ones";
  EXPECT_EQ(
      speaks_on({{std::numeric_limits<std::int32_t>::min(), 0}, {std::numeric_limits<std::int32_t>::max(), 0}}).size(),
      2u);
}

TEST(CellChannels, WhoListensForACellHearsAllThatMentionIt) {
  std::mt19937 random(1);
  for (int i = 0; i < 2000; ++i) {
    const auto number = [&random](int below) {
      return static_cast<std::int32_t>(random() % static_cast<unsigned>(below));
    };
    std::set<Cell> cells;
    for (int n = 1 + number(5), reach = 1 + number(4); n > 0; --n) cells.insert({number(reach) - 2, number(reach) - 2});
    const std::vector<std::string> spoken = speaks_on(cells);
    const auto hears = [&spoken](const Cell& cell) {
      const std::set<std::string> heard = heard_on({cell});
      return std::ranges::any_of(spoken, [&heard](const std::string& channel) { return heard.contains(channel); });
    };
    std::int32_t width = 0;
    for (const Cell& a : cells) {
      EXPECT_TRUE(hears(a)) << i << ": " << a.x << ", " << a.y;
      for (const Cell& b : cells) width = std::max({width, a.x - b.x, a.y - b.y});
    }
    EXPECT_EQ(spoken.size(), width <= 1 ? 1u : cells.size()) << i;
    for (std::int32_t x = -5; x <= 5; ++x) {
      for (std::int32_t y = -5; y <= 5; ++y) {
        const bool is_near = std::ranges::any_of(
            cells, [&](const Cell& cell) { return std::max(std::abs(cell.x - x), std::abs(cell.y - y)) <= 1; });
        EXPECT_TRUE(is_near || !hears({x, y})) << i << ": " << x << ", " << y;
      }
    }
  }
}

}  // namespace
}  // namespace swarm
