// What the bridge to ROS 2 tells its operator: changes as they come, and every ten seconds where things stand.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "lcmtypes/bus/recurring.h"
#include "tools/bridge/log_line.h"
#include "tools/ros2/ros2_node.h"

namespace swarm {

class Ros2Log {
 public:
  // What there is to say at `now`. To be called some ten times a second.
  std::vector<LogLine> update(Utime now, const Ros2Report& report);

 private:
  bool is_silent_ = false;
  std::int64_t refused_ = 0;
  Recurring refusal_;
  std::optional<Recurring> summary_;
};

}  // namespace swarm
