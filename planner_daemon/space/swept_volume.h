// Shared trajectories in the SOGM (paper section III-C): what a peer sweeps during a frame is occupied in that frame.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "map_daemon/dilation.h"
#include "planner_daemon/trajectory/motion.h"

namespace swarm {

// Keeps its memory from one use to the next.
class SweptVolumes {
 public:
  // For frames laid out like those of `sogm`; holds nothing yet.
  void lay_out(const Sogm& sogm);

  bool empty() const { return words_.empty(); }

  // Adds the voxels whose centre comes within `radius_m` of the motion during a frame's interval, hover tail included
  // (the last frame stays in force: all that comes after belongs to it), though it may come earlier or later by up to
  // `clock_error` >= 0; in frame i at least those in columns bounds[i] of the window. Conservative: each span of the
  // curve is covered by its chord, widened by how far its control points lie from the chord, so the hull of the span
  // and with it the curve is inside.
  void add(const Motion& motion, double radius_m, Duration clock_error, std::span<const Columns> bounds);

  // Appends what a frame holds within `columns`. Valid until the next add().
  void append_layers(int frame, const Columns& columns, std::vector<Layer>* layers) const;

 private:
  struct Patch {
    Columns columns;
    std::size_t first;  // of its words
  };
  std::optional<Patch> mark_capsule(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius_m,
                                    const Columns& bounds);
  std::size_t row_of(const Patch& patch) const {
    return static_cast<std::size_t>(patch.columns.width()) * static_cast<std::size_t>(grid_.words_per_column());
  }

  GridGeometry grid_;
  Utime start_utime_{};
  Duration frame_duration_{1};
  std::vector<std::vector<Patch>> patches_;  // by frame
  std::vector<std::uint64_t> words_;
  std::vector<double> low_m_, high_m_;  // where a row of columns meets a capsule
};

}  // namespace swarm
