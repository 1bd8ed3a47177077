// SOGMs of which only what a robot can reach is worked out: the rest would never be looked at.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

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

// Bits are set in a box of columns per frame; all else is clear. Keeps its memory, and clears only what was written.
class PartialSogm {
 public:
  const Sogm& map() const { return map_; }
  const Columns& written(int frame) const { return written_[static_cast<std::size_t>(frame)]; }

  // What was written before is there until its frame is claimed.
  void lay_out(const GridGeometry& geometry, int num_frames, std::int64_t start_utime, std::int64_t frame_duration_us);
  void lay_out(const Sogm& like) { lay_out(like.geometry, like.num_frames, like.start_utime, like.frame_duration_us); }
  // The caller is about to set all words of these columns, from column() on; the frame's others are cleared.
  void claim(int frame, const Columns& columns);
  std::uint64_t* column(int frame, int x, int y) { return map_.column(frame, x, y); }

  // Claims the columns and copies them from `from`, of the same layout.
  void copy(const Sogm& from, int frame, const Columns& columns);
  // Claims what is reached: what is occupied in `from` in the same frame or up to `frames_before` before.
  void accumulate(const Sogm& from, int frames_before, const Reach& reach);

 private:
  Sogm map_;
  std::vector<Columns> written_;               // by frame
  std::vector<const std::uint64_t*> sources_;  // of accumulate()
};

}  // namespace swarm
