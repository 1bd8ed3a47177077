// How much there may be of what messages carry. Each limit stands once: in its message's .lcm file, or here.
#pragma once

#include <cstdint>

#include "lcmtypes/bus/time.h"
#include "sogm_swarm/announcement_t.hpp"
#include "sogm_swarm/cell_announcement_t.hpp"
#include "sogm_swarm/cell_roster_t.hpp"
#include "sogm_swarm/corridors_t.hpp"
#include "sogm_swarm/depth_image_t.hpp"
#include "sogm_swarm/goal_t.hpp"
#include "sogm_swarm/last_words_t.hpp"
#include "sogm_swarm/lidar_scan_t.hpp"
#include "sogm_swarm/obstacle_voxels_t.hpp"
#include "sogm_swarm/obstacles_t.hpp"
#include "sogm_swarm/packed_announcement_t.hpp"
#include "sogm_swarm/sogm_t.hpp"
#include "sogm_swarm/trajectory_t.hpp"

namespace swarm {

inline constexpr int kMaxRosterRobots = sogm_swarm::announcement_t::kMaxAcks;  // that fly together
inline constexpr int kMaxStrangers = 16;                                       // that a robot hears besides
inline constexpr int kMaxPackedBytes = sogm_swarm::packed_announcement_t::kMaxBytes;
inline constexpr int kMaxTrajectoryPieces = sogm_swarm::trajectory_t::kMaxPieces;
inline constexpr int kMaxFaces = sogm_swarm::corridors_t::kMaxFaces;  // of all corridors of a plan
inline constexpr int kMaxTrackedObstacles = sogm_swarm::obstacles_t::kMaxObstacles;
inline constexpr int kMaxObstacleVoxels = sogm_swarm::obstacle_voxels_t::kMaxVoxels;  // of one obstacle
inline constexpr double kMaxObstacleSize_m = 1000.0;

// Of what range sensors measure.
inline constexpr int kMaxSensors = sogm_swarm::lidar_scan_t::kMaxSensors;  // of a robot
inline constexpr int kMaxDepthPixels = sogm_swarm::depth_image_t::kMaxPixels;
inline constexpr int kMaxScanCoordinates = sogm_swarm::lidar_scan_t::kMaxCoordinates;  // of a part
inline constexpr int kMaxScanParts = sogm_swarm::lidar_scan_t::kMaxParts;

// Of a mission.
inline constexpr int kMaxWaypoints = sogm_swarm::goal_t::kMaxWaypoints;
inline constexpr double kMaxTolerance_m = 1000.0, kLeastSpeed_mps = 0.05, kMaxWait_s = 86400.0;

// Of a take-off.
inline constexpr double kLeastClimb_m = 0.1, kMaxClimb_m = 100.0;

// Of a map.
inline constexpr int kMaxMapFrames = sogm_swarm::sogm_t::kMaxFrames;
inline constexpr int kMaxVoxelsPerAxis = sogm_swarm::sogm_t::kMaxVoxelsPerAxis;
inline constexpr int kMaxVoxelsPerFrame = 1 << 24;
inline constexpr int kMaxParts = sogm_swarm::sogm_t::kMaxParts;
inline constexpr int kMaxPartBytes = sogm_swarm::sogm_t::kMaxPartBytes;            // compressed
inline constexpr int kMaxCompressedMapBytes = sogm_swarm::sogm_t::kMaxTotalBytes;  // all parts together
inline constexpr std::int64_t kMaxMapBytes = std::int64_t{1} << 24;  // decompressed, all frames; the planner has seven
inline constexpr int kMaxWorldIndex = 1 << 30;  // of a voxel, either sign: sums of two never overflow

// Of numbers on the wire, per axis where they have axes.
inline constexpr double kMaxPosition_m = 1e5;
inline constexpr double kMaxVelocity_mps = 100.0;
inline constexpr double kMaxAcceleration_mps2 = 1e3;
inline constexpr double kMaxJerk_mps3 = 1e5;
inline constexpr Utime kMaxUtime = to_utime(std::int64_t{1} << 53);  // sums of times never overflow

// Knots of trajectories that are flown are in whole steps: of 0.1 mm, 1 mm/s and 1 cm/s^2.
inline constexpr double kStepsPerMetre = 1e4, kStepsPerMps = 1e3, kStepsPerMps2 = 1e2;

// Of what a robot proposes to fly, from then on.
inline constexpr Duration kMaxAhead = 2s;    // it begins
inline constexpr Duration kMaxMotion = 10s;  // it ends: so long may a robot fly by a clock that is wrong

static_assert(sogm_swarm::depth_image_t::kMaxSensors == kMaxSensors, "sensors of both kinds are counted together");
static_assert(sogm_swarm::last_words_t::kMaxBytes == kMaxPackedBytes, "the same announcements");
static_assert(sogm_swarm::cell_announcement_t::kMaxBytes == kMaxPackedBytes, "the same frame");
static_assert(sogm_swarm::cell_roster_t::kMaxBytes == kMaxPackedBytes, "the same frame");
static_assert(kMaxParts * kMaxPartBytes <= kMaxCompressedMapBytes, "what parts can carry may be said");
static_assert(kMaxVoxelsPerFrame / 8 <= kMaxMapBytes, "a frame fits a map");
static_assert(sizeof(sogm_swarm::trajectory_t::knots) / sizeof(sogm_swarm::trajectory_t::knots[0]) ==
              kMaxTrajectoryPieces + 1);

}  // namespace swarm
