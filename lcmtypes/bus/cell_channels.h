// On which channels of the swarm bus is said what is for which cells: a keeper speaks on its cell's own, a robot on
// that of the block that holds all cells that it mentions, so that it says once what is for several.
#pragma once

#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "lcmtypes/bus/cell_messages.h"

namespace swarm {

// The cell's own channel of a kind: CELL_ROSTER_at_m3_12, m for minus. Who has nothing to do with the cell does not
// listen to it.
std::string channel_of(std::string_view kind, const Cell& cell);

// Where a robot speaks that mentions these cells. Blocks are of 1 x 1, 2 x 1, 1 x 2 or 2 x 2 cells, and have a channel
// each: CELL_ANNOUNCEMENT_at_m3_12, or CELL_ANNOUNCEMENT_at_m3_12_2x1. It is the one of the smallest that holds
// all; where none does, that of each cell.
std::vector<std::string> speaks_on(const std::set<Cell>& cells);

// All that is said for these cells, by their keepers and by robots: of each those of the nine blocks that hold it.
std::set<std::string> heard_on(const std::set<Cell>& cells);

}  // namespace swarm
