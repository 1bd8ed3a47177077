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

// Where whoever follows a track would come into being after the beginning of the flight, as where a camera first saw
// them: they are there `lead_s` earlier, and walk up to the first point of their track as they go on from it. Nothing
// is in the way of that, walls neither.
std::vector<WorldObstacle> walking_up(std::vector<WorldObstacle> obstacles, double lead_s);

}  // namespace swarm
