// The points of a scan as LIDAR_SCAN, in parts that fit a message each.
#pragma once

#include <Eigen/Geometry>
#include <span>
#include <vector>

#include "lcmtypes/bus/node.h"
#include "sogm_swarm/header_t.hpp"

namespace swarm {

// Leaves evenly so many of them that they fit a scan. False when all do.
bool thin_to_fit(std::vector<Eigen::Vector3d>* points);

// `sensor` [0, kMaxSensors) was at `position` W [m], turned from its frame to W by `orientation`; `points` in its frame
// [m], as many as fit. What is further away than the message can say is told as free up to there.
void publish_scan(const sogm_swarm::header_t& header, int sensor, const Eigen::Vector3d& position,
                  const Eigen::Quaterniond& orientation, std::span<const Eigen::Vector3d> points, Outbox& outbox);

}  // namespace swarm
