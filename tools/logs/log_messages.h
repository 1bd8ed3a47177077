// What our channels carry.
#pragma once

#include <optional>
#include <span>
#include <string_view>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/codec.h"

namespace swarm {

// Decodes bytes as what the channel carries and calls use(message) when they are accepted; `use` takes every type of
// codec.h. Nothing when the channel is not one of ours.
template <class Use>
std::optional<Refusal> visit_message(std::string_view name, std::span<const std::uint8_t> bytes, Use&& use) {
  using namespace sogm_swarm;
  const auto as = [&]<class T>(T message) {
    const Refusal refusal = decode(bytes, &message);
    if (refusal == Refusal::kNone) use(message);
    return refusal;
  };
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
