#pragma once

#include "map_daemon/sogm.h"

namespace swarm {

// Zones may be worked out only where the search looks.
class ZoneSource {
 public:
  virtual ~ZoneSource() = default;
  // The blocked zone, and in an emergency the tight and the contact zone, are about to be looked at in these columns of
  // frames first to last; beyond the window nothing is known.
  virtual void prepare_blocked(int first_frame, int last_frame, const Columns& columns) = 0;
  // And the near zone and the wake.
  virtual void prepare(int first_frame, int last_frame, const Columns& columns) = 0;
};

}  // namespace swarm
