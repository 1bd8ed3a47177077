// What the motion capture input tells its operator: changes as they come, and every ten seconds where things stand.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "lcmtypes/bus/recurring.h"
#include "tools/bridge/log_line.h"
#include "tools/bridge/mocap_node.h"

namespace swarm {

class MocapLog {
 public:
  // What there is to say at `now`. To be called some ten times a second.
  std::vector<LogLine> update(Utime now, const MocapReport& report);

 private:
  bool heard_ = false;
  int obstacles_ = 0;
  std::int64_t refused_ = 0;
  std::optional<Recurring> summary_;
  Recurring refusal_;
};

}  // namespace swarm
