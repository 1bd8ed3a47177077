// Channel names. See lcmtypes/README.md for types, sizes and rates.
#pragma once

namespace swarm::channel {

// Onboard bus.
inline constexpr char kRobotState[] = "ROBOT_STATE";
inline constexpr char kObstacles[] = "OBSTACLES";
inline constexpr char kObstacleVoxels[] = "OBSTACLE_VOXELS";
inline constexpr char kGoal[] = "GOAL";
inline constexpr char kSogm[] = "SOGM";
inline constexpr char kCandidate[] = "CANDIDATE";
inline constexpr char kOwnTrajectory[] = "OWN_TRAJECTORY";    // the robot's own announcement
inline constexpr char kPeerTrajectory[] = "PEER_TRAJECTORY";  // peers' announcements, relayed byte for byte
inline constexpr char kSetpoint[] = "SETPOINT";
inline constexpr char kCorridors[] = "CORRIDORS";
inline constexpr char kMapStatus[] = "MAP_STATUS";
inline constexpr char kPlannerStatus[] = "PLANNER_STATUS";
inline constexpr char kBroadcastStatus[] = "BROADCAST_STATUS";

// Swarm bus.
inline constexpr char kTrajectory[] = "TRAJECTORY";

}  // namespace swarm::channel
