// What the bridge to ROS 2 tells its operator: changes as they come, and every ten seconds where things stand.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
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
  struct Told {
    std::int64_t count = 0;
    Recurring line;
  };
  // Says how many more there are than were told, once in ten seconds the most.
  static void tell_more(std::vector<LogLine>* lines, Utime now, std::int64_t count, const char* what,
                        const std::string& newest, Told* told);

  bool is_silent_ = false;
  Told refused_, unpublished_;
  std::optional<Recurring> summary_;
};

}  // namespace swarm
