// People that were recorded as they walked, as obstacles of a hall.
#pragma once

#include <filesystem>
#include <vector>

#include "swarm_sim/world/world.h"

namespace swarm {

// Those columns of a world file that follow tracks, turned so that they walk along x for the most part, and put as
// far to one side as lets most of them stay within `hall` (W [m], the whole shape) all the way from one of its ends to
// the other: these alone, as long as they are between the ends. Who would come into being in the midst of it, later
// than half a second after the beginning, is left out: no door is there.
// Throws WorldError when nobody is left, and what read_world() throws.
std::vector<WorldObstacle> walkers_in(const std::filesystem::path& file, const Rectangle& hall);

}  // namespace swarm
