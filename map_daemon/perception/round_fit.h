// The upright column that a range sensor saw one side of, from above: a circle.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

namespace swarm {

// What is known of a radius: as if `weight` surface points had measured it.
struct RadiusPrior {
  double radius_m = 0.0;
  double weight = 0.0;
};

struct RoundFit {
  Eigen::Vector2d center = Eigen::Vector2d::Zero();  // W [m]
  RadiusPrior radius;                                // as known now
  int on_circle = 0;                                 // points that are near it
  double rms_m = 0.0;                                // of these about it
  double sigma_m = 0.0;  // standard deviation of the center along its worse axis, for points that err by `noise_m`
  bool converged = false;
};

// So near to the circle a point is on it, times the noise.
inline constexpr double kOnCircle = 4.0;

// Least squares of the distances of `points` (W [m], three or more) from the circle, and of its radius from what was
// known of it; points that are far from it count little. They are on the side towards `sensor`. `noise_m`: standard
// deviation of a point.
RoundFit fit_round(std::span<const Eigen::Vector2d> points, const Eigen::Vector2d& sensor, const RadiusPrior& prior,
                   double noise_m);

// How many times more `points` vary around the best line than around this circle: little, if they may be of something
// flat.
double curvature(std::span<const Eigen::Vector2d> points, const RoundFit& fit);

// Columns that stand so close together that they were taken for one thing: the one that most of `points` lie on, if
// there is one. It bulges towards the sensor, nothing is seen inside of it, and of its side enough to tell it from a
// wall.
std::optional<RoundFit> find_round(std::span<const Eigen::Vector2d> points, const Eigen::Vector2d& sensor,
                                   double noise_m);

}  // namespace swarm
