// An SOGM with the peers' swept volumes drawn in (paper section III-C).
#pragma once

#include <vector>

#include "map_daemon/dilation.h"
#include "planner_daemon/space/swept_volume.h"

namespace swarm {

struct Occupancy {
  const Sogm* sogm = nullptr;
  const SweptVolumes* peers = nullptr;  // laid out like it; null: none
  const SweptVolumes* apart = nullptr;  // likewise: what is kept clear of besides

  // What is occupied in a frame within `columns`.
  void append_layers(int frame, const Columns& columns, std::vector<Layer>* layers) const {
    layers->push_back(layer_of(*sogm, frame));
    for (const SweptVolumes* volumes : {peers, apart})
      if (volumes != nullptr) volumes->append_layers(frame, columns, layers);
  }
};

}  // namespace swarm
