// An OctoMap from above, in letters.
#pragma once

#include <octomap/OcTree.h>

#include <string>

namespace swarm {

struct PictureOptions {
  double low_m = -1e9, high_m = 1e9;  // of what is shown
  int columns = 100;                  // at most
};

// Lines of '#' (something stands), '.' (all that is known is free) and ' ' (nothing is known); y grows upwards. Empty
// where nothing is known between low and high.
std::string picture_of(const octomap::OcTree& map, const PictureOptions& options);

}  // namespace swarm
