// All messages there are, each once: its type, its channels and its variable array. Whatever goes by the list of
// messages is made from this one: channel names, types, decoding, what is validated, JSON, what is listened to.
#pragma once

// MESSAGE(type, its channels): SWARM_ON(constant of namespace channel, name, bus) each; and where it has one, its
// array: SWARM_ARRAY(the count, the elements, bytes of one element on the wire, how many there may be). Who needs
// channels or arrays defines the two before MESSAGE uses them.
#define SWARM_MESSAGES(MESSAGE)                                                                                       \
  MESSAGE(robot_state_t, SWARM_ON(kRobotState, "ROBOT_STATE", kOnboard))                                              \
  MESSAGE(obstacles_t, SWARM_ON(kObstacles, "OBSTACLES", kOnboard),                                                   \
          SWARM_ARRAY(num_obstacles, obstacles, 102, kMaxTrackedObstacles))                                           \
  MESSAGE(obstacle_voxels_t, SWARM_ON(kObstacleVoxels, "OBSTACLE_VOXELS", kOnboard),                                  \
          SWARM_ARRAY(num_voxels, voxels, 6, kMaxObstacleVoxels))                                                     \
  MESSAGE(depth_image_t, SWARM_ON(kDepthImage, "DEPTH_IMAGE", kOnboard),                                              \
          SWARM_ARRAY(num_pixels, depth_mm, 2, kMaxDepthPixels))                                                      \
  MESSAGE(lidar_scan_t, SWARM_ON(kLidarScan, "LIDAR_SCAN", kOnboard),                                                 \
          SWARM_ARRAY(num_coordinates, coordinates, 2, kMaxScanCoordinates))                                          \
  MESSAGE(goal_t, SWARM_ON(kGoal, "GOAL", kOnboard), SWARM_ARRAY(num_waypoints, waypoints, 48, kMaxWaypoints))        \
  MESSAGE(order_t, SWARM_ON(kFlightOrder, "FLIGHT_ORDER", kOnboard))                                                  \
  MESSAGE(vehicle_status_t, SWARM_ON(kVehicleStatus, "VEHICLE_STATUS", kOnboard))                                     \
  MESSAGE(flight_status_t, SWARM_ON(kFlightStatus, "FLIGHT_STATUS", kOnboard))                                        \
  MESSAGE(sogm_t,                                                                                                     \
          SWARM_ON(kSogm, "SOGM", kOnboard)                                                                           \
              SWARM_ON(kSeenSpace, "SEEN_SPACE", kOnboard), /* one frame: what stands; a second: what was not seen */ \
          SWARM_ARRAY(num_bytes, packed, 1, kMaxPartBytes))                                                           \
  MESSAGE(candidate_t, SWARM_ON(kCandidate, "CANDIDATE", kOnboard))                                                   \
  MESSAGE(announcement_t,                                                                                             \
          SWARM_ON(kOwnTrajectory, "OWN_TRAJECTORY", kOnboard)    /* of the robot itself, as it is announced */       \
          SWARM_ON(kPeerTrajectory, "PEER_TRAJECTORY", kOnboard), /* of its peers, as they announce it */             \
          SWARM_ARRAY(num_acks, acks, 9, kMaxRosterRobots))                                                           \
  MESSAGE(setpoint_t, SWARM_ON(kSetpoint, "SETPOINT", kOnboard))                                                      \
  MESSAGE(corridors_t, SWARM_ON(kCorridors, "CORRIDORS", kOnboard), SWARM_ARRAY(num_faces, faces, 18, kMaxFaces))     \
  MESSAGE(map_status_t, SWARM_ON(kMapStatus, "MAP_STATUS", kOnboard))                                                 \
  MESSAGE(perception_status_t, SWARM_ON(kPerceptionStatus, "PERCEPTION_STATUS", kOnboard))                            \
  MESSAGE(map_request_t, SWARM_ON(kSaveMap, "SAVE_MAP", kOnboard))                                                    \
  MESSAGE(planner_status_t, SWARM_ON(kPlannerStatus, "PLANNER_STATUS", kOnboard))                                     \
  MESSAGE(broadcast_status_t, SWARM_ON(kBroadcastStatus, "BROADCAST_STATUS", kOnboard))                               \
  MESSAGE(packed_announcement_t, SWARM_ON(kAnnouncement, "ANNOUNCEMENT", kSwarm),                                     \
          SWARM_ARRAY(num_bytes, packed, 1, kMaxPackedBytes))                                                         \
  MESSAGE(last_words_t, SWARM_ON(kLastWords, "LAST_WORDS", kSwarm),                                                   \
          SWARM_ARRAY(num_bytes, packed, 1, kMaxPackedBytes))                                                         \
  MESSAGE(cell_announcement_t,                                                                                        \
          SWARM_ON(kCellAnnouncement, "CELL_ANNOUNCEMENT", kSwarm), /* and the cell: channel_of() */                  \
          SWARM_ARRAY(num_bytes, packed, 1, kMaxPackedBytes))                                                         \
  MESSAGE(cell_roster_t, SWARM_ON(kCellRoster, "CELL_ROSTER", kSwarm), /* likewise */                                 \
          SWARM_ARRAY(num_bytes, packed, 1, kMaxPackedBytes))
