#include "planner_daemon/trajectory/bezier.h"

namespace swarm {

ControlPoints quintic_control_points(const MotionState& from, const MotionState& to, double h_s) {
  ControlPoints c;
  c.col(0) = from.position;
  c.col(1) = from.position + h_s / 5 * from.velocity;
  c.col(2) = 2 * c.col(1) - c.col(0) + h_s * h_s / 20 * from.acceleration;
  c.col(5) = to.position;
  c.col(4) = to.position - h_s / 5 * to.velocity;
  c.col(3) = 2 * c.col(4) - c.col(5) + h_s * h_s / 20 * to.acceleration;
  return c;
}

MotionState evaluate_bezier(const ControlPoints& points, double h_s, double s) {
  // de Casteljau: the last triangles are the differences of the derivatives.
  ControlPoints c = points;
  MotionState state;
  for (int left = 5; left > 0; --left) {
    if (left == 3) state.jerk = 60 / (h_s * h_s * h_s) * (c.col(3) - 3 * c.col(2) + 3 * c.col(1) - c.col(0));
    if (left == 2) state.acceleration = 20 / (h_s * h_s) * (c.col(2) - 2 * c.col(1) + c.col(0));
    if (left == 1) state.velocity = 5 / h_s * (c.col(1) - c.col(0));
    for (int j = 0; j < left; ++j) c.col(j) = (1 - s) * c.col(j) + s * c.col(j + 1);
  }
  state.position = c.col(0);
  return state;
}

Eigen::Vector3d bezier_position(const ControlPoints& points, double s) {
  const double r = 1.0 - s, r2 = r * r, s2 = s * s;
  return r2 * r * (r2 * points.col(0) + 5 * r * s * points.col(1) + 10 * s2 * points.col(2)) +
         s2 * s * (10 * r2 * points.col(3) + 5 * r * s * points.col(4) + s2 * points.col(5));
}

// De Casteljau: what is left of `to`, and of that what is right of `from`.
ControlPoints part_of(const ControlPoints& points, double from, double to) {
  ControlPoints part = points;
  for (int level = 1; level <= 5; ++level) {
    for (int i = 5; i >= level; --i) part.col(i) = (1.0 - to) * part.col(i - 1) + to * part.col(i);
  }
  const double u = from / to;
  for (int level = 1; level <= 5; ++level) {
    for (int i = 0; i <= 5 - level; ++i) part.col(i) = (1.0 - u) * part.col(i) + u * part.col(i + 1);
  }
  return part;
}

double max_speed_bound(const ControlPoints& points, double h_s) {
  return 5 / h_s * (points.rightCols<5>() - points.leftCols<5>()).cwiseAbs().maxCoeff();
}

AccelerationPoints acceleration_points(const ControlPoints& points, double h_s) {
  return 20 / (h_s * h_s) * (points.rightCols<4>() - 2 * points.middleCols<4>(1) + points.leftCols<4>());
}

double max_acceleration_bound(const ControlPoints& points, double h_s) {
  return acceleration_points(points, h_s).cwiseAbs().maxCoeff();
}

}  // namespace swarm
