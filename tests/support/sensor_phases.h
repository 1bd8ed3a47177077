// When the simulated sensors of a flight spoke, which is the same in every mode.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/lcm_log.h"

namespace swarm::test {

// Of robot `index` in the world's order, by the log of its onboard bus: its state every 10 ms; obstacles every 50 ms,
// so much earlier than those of the first robot as it comes later in the order; the goal every second. In real time
// only a `share` may be in time.
inline void expect_sensor_phases(const std::filesystem::path& log_path, int index, double share = 1.0) {
  LcmLog log(log_path);
  int states = 0, detections = 0, goals = 0, off_state = 0, off_detection = 0, off_goal = 0;
  Duration first_goal{};
  const auto time_of = [](const auto& message) { return Duration(message.header.utime); };
  for (LogEvent event; log.next(&event);) {
    if (sogm_swarm::robot_state_t state;
        event.channel == channel::kRobotState && decode(event.bytes, &state) == Refusal::kNone) {
      ++states;
      off_state += time_of(state) % 10ms != 0ms;
    }
    if (sogm_swarm::obstacles_t obstacles;
        event.channel == channel::kObstacles && decode(event.bytes, &obstacles) == Refusal::kNone) {
      const bool is_first = detections++ == 0;  // comes at once
      off_detection += !is_first && (time_of(obstacles) + index * 10ms) % 50ms != 0ms;
    }
    if (sogm_swarm::goal_t goal; event.channel == channel::kGoal && decode(event.bytes, &goal) == Refusal::kNone) {
      if (goals++ == 0) first_goal = time_of(goal);
      off_goal += (time_of(goal) - first_goal) % 1s != 0s;
    }
  }
  EXPECT_EQ(off_state, 0) << "of " << states;
  EXPECT_LE(off_detection, (1.0 - share) * detections) << "of " << detections;
  EXPECT_LE(off_goal, (1.0 - share) * goals) << "of " << goals;
  EXPECT_GT(goals, 1);
  EXPECT_GT(detections, 10 * share * goals);
  EXPECT_GT(states, 4 * share * detections);
}

}  // namespace swarm::test
