#include "tools/logs/polytope_faces.h"

#include <Eigen/Geometry>
#include <cmath>
#include <map>
#include <utility>

namespace swarm {
namespace {

constexpr double kShortest = 1e-9;    // of a normal
constexpr double kOutside_m = 1e-9;   // what lies less far outside is kept
constexpr double kTogether_m = 1e-6;  // corners nearer than this are one

// What of a convex polygon lies in the half-space of unit normal.
void clip(const HalfSpace& half_space, Polygon* polygon, Polygon* scratch) {
  scratch->clear();
  const std::size_t size = polygon->size();
  for (std::size_t i = 0; i < size; ++i) {
    const Eigen::Vector3d& from = (*polygon)[i];
    const Eigen::Vector3d& to = (*polygon)[i + 1 < size ? i + 1 : 0];
    const double outside_from = half_space.normal.dot(from) - half_space.offset;
    const double outside_to = half_space.normal.dot(to) - half_space.offset;
    if (outside_from <= kOutside_m) scratch->push_back(from);
    if ((outside_from > kOutside_m) != (outside_to > kOutside_m))
      scratch->push_back(from + outside_from / (outside_from - outside_to) * (to - from));
  }
  polygon->swap(*scratch);
}

// Joins corners that are one; an edge or a corner alone is no face.
void tidy(Polygon* polygon, Polygon* scratch) {
  scratch->clear();
  const auto together = [](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return (a - b).squaredNorm() < kTogether_m * kTogether_m;
  };
  for (const Eigen::Vector3d& corner : *polygon) {
    if (scratch->empty() || !together(corner, scratch->back())) scratch->push_back(corner);
  }
  while (scratch->size() > 1 && together(scratch->front(), scratch->back())) scratch->pop_back();
  polygon->swap(*scratch);
  if (polygon->size() < 3) polygon->clear();
}

// A square in the plane of a half-space of unit normal.
Polygon square(const HalfSpace& plane, const Eigen::Vector3d& middle, double reach_m) {
  const Eigen::Vector3d foot = middle + (plane.offset - plane.normal.dot(middle)) * plane.normal;
  const Eigen::Vector3d u = reach_m * plane.normal.unitOrthogonal(), v = plane.normal.cross(u);
  return {foot + u + v, foot - u + v, foot - u - v, foot + u - v};
}

bool same(const HalfSpace& a, const HalfSpace& b) {
  return (a.normal - b.normal).squaredNorm() < kShortest * kShortest && std::abs(a.offset - b.offset) < kOutside_m;
}

}  // namespace

std::vector<Polygon> polytope_faces(std::span<const HalfSpace> half_spaces, const Eigen::Vector3d& middle,
                                    double reach_m) {
  std::vector<HalfSpace> units;
  for (const HalfSpace& given : half_spaces) {
    const double length = given.normal.norm();
    HalfSpace& unit = units.emplace_back(HalfSpace{Eigen::Vector3d::Zero(), 0.0});
    if (length >= kShortest) unit = {given.normal / length, given.offset / length};
  }
  std::vector<Polygon> faces(units.size());
  Polygon scratch;
  for (std::size_t i = 0; i < units.size(); ++i) {
    if (units[i].normal.isZero()) continue;
    Polygon& face = faces[i] = square(units[i], middle, reach_m);
    for (std::size_t j = 0; j < units.size() && !face.empty(); ++j) {
      if (j == i || units[j].normal.isZero()) continue;
      if (j < i && same(units[i], units[j])) {
        face.clear();
      } else if (!same(units[i], units[j])) {
        clip(units[j], &face, &scratch);
      }
    }
    tidy(&face, &scratch);
  }
  return faces;
}

std::vector<CorridorPiece> corridor_pieces(const sogm_swarm::corridors_t& corridors) {
  std::map<int, CorridorPiece> pieces;
  for (const sogm_swarm::face_t& face : corridors.faces) {
    CorridorPiece& piece = pieces[face.piece];
    piece.piece = face.piece;
    piece.half_spaces.push_back({Eigen::Vector3d(face.normal[0], face.normal[1], face.normal[2]), face.offset});
  }
  std::vector<CorridorPiece> sorted;
  for (auto& [number, piece] : pieces) sorted.push_back(std::move(piece));
  return sorted;
}

}  // namespace swarm
