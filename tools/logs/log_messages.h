// Our messages in the events of LCM logs.
#pragma once

#include <optional>
#include <string_view>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/lcm_log.h"

namespace swarm {

// Decodes an event as what its channel carries and calls use(message) when it is accepted; `use` takes every type of
// codec.h. Nothing when the channel is not one of ours.
template <class Use>
std::optional<Refusal> visit_message(const LogEvent& event, Use&& use) {
  using namespace sogm_swarm;
  const auto as = [&]<class T>(T message) {
    const Refusal refusal = decode(event.bytes, &message);
    if (refusal == Refusal::kNone) use(message);
    return refusal;
  };
  const std::string_view name = event.channel;
  for (const char* announcements : {channel::kTrajectory, channel::kOwnTrajectory, channel::kPeerTrajectory}) {
    if (name == announcements) return as(announcement_t{});
  }
  if (name == channel::kRobotState) return as(robot_state_t{});
  if (name == channel::kSetpoint) return as(setpoint_t{});
  if (name == channel::kObstacles) return as(obstacles_t{});
  if (name == channel::kObstacleVoxels) return as(obstacle_voxels_t{});
  if (name == channel::kGoal) return as(goal_t{});
  if (name == channel::kSogm) return as(sogm_t{});
  if (name == channel::kCandidate) return as(candidate_t{});
  if (name == channel::kCorridors) return as(corridors_t{});
  if (name == channel::kMapStatus) return as(map_status_t{});
  if (name == channel::kPlannerStatus) return as(planner_status_t{});
  if (name == channel::kBroadcastStatus) return as(broadcast_status_t{});
  return std::nullopt;
}

}  // namespace swarm
