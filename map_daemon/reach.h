// Where a robot can come to while a frame of the SOGM is in force: the rest need not be worked out.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>

#include "map_daemon/sogm.h"

namespace swarm {

// Where something can come to that is at `center` with `velocity` at `utime`, never faster than `speed_mps` along x or
// y, until `horizon_s` later.
struct Reach {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  // W [m]
  std::int64_t utime = 0;
  double speed_mps = 0.0;
  double horizon_s = 0.0;
  double acceleration_mps2 = std::numeric_limits<double>::infinity();  // it turns at once
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();                  // W [m/s]
};

// Where along an axis (0, 1) that is at some time within [from_s, to_s], 0 <= from_s <= to_s, after `utime`: W [m].
struct Span {
  double low, high;
};
Span span(const Reach& reach, int axis, double from_s, double to_s);

// A box [first, last] of columns of the window, indices along x and y; none when a first is above its last.
struct Columns {
  Eigen::Vector2i first = Eigen::Vector2i::Zero(), last = Eigen::Vector2i::Constant(-1);

  bool empty() const { return (first.array() > last.array()).any(); }
  int width() const { return last.y() - first.y() + 1; }  // along y
  // With `margin` more to each side, as far as the window goes.
  Columns grown(int margin, const GridGeometry& geometry) const;
};

Columns all_columns(const GridGeometry& geometry);

inline bool intersect(const Columns& a, const Columns& b) {
  return (a.first.array() <= b.last.array()).all() && (b.first.array() <= a.last.array()).all();
}

// visit(x, first_y, last_y) for the rows of `all`, as far as they are not in `kept`.
template <class Visit>
void for_each_outside(const Columns& all, const Columns& kept, const Visit& visit) {
  for (int x = all.first.x(); x <= all.last.x(); ++x) {
    const auto row = [&](int first_y, int last_y) {
      if (first_y <= last_y) visit(x, first_y, last_y);
    };
    if (kept.empty() || x < kept.first.x() || x > kept.last.x()) {
      row(all.first.y(), all.last.y());
    } else {
      row(all.first.y(), std::min(all.last.y(), kept.first.y() - 1));
      row(std::max(all.first.y(), kept.last.y() + 1), all.last.y());
    }
  }
}

// What `reach` comes to while the frame is in force (the last one stays for ever) or up to `linger_s` later; at most a
// voxel more to each side.
Columns reached(const Sogm& sogm, int frame, const Reach& reach, double linger_s = 0.0);

}  // namespace swarm
