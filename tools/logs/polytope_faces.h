// The faces of a convex polytope as polygons, for drawing corridors.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "sogm_swarm/corridors_t.hpp"

namespace swarm {

// Points p with normal . p <= offset; W [m].
struct HalfSpace {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitX();  // outwards
  double offset = 0.0;
};

using Polygon = std::vector<Eigen::Vector3d>;  // corners in order, counter-clockwise seen from outside; W [m]

// Polygon i is the face of the polytope in the plane of half-space i; empty when it has none there: the half-space is
// redundant, equals an earlier one, or its normal is shorter than 1e-9. Faces are exact as far as `reach_m` from the
// foot of `middle` [W, m] on their plane; what is further away, as of a polytope that is not bounded, is cut off.
std::vector<Polygon> polytope_faces(std::span<const HalfSpace> half_spaces, const Eigen::Vector3d& middle,
                                    double reach_m);

struct CorridorPiece {
  int piece = 0;  // of the trajectory
  std::vector<HalfSpace> half_spaces;
};

// The polytopes of a message, ascending in their pieces; pieces without faces are left out.
std::vector<CorridorPiece> corridor_pieces(const sogm_swarm::corridors_t& corridors);

}  // namespace swarm
