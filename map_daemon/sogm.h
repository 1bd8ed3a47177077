// The spatiotemporal occupancy grid map (SOGM), paper section III-B: a sequence of bit grids over a window around the
// robot; frame i is the union of what is occupied during [start + i d, start + (i + 1) d].
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "lcmtypes/bus/eigen_alignment.h"
#include "lcmtypes/bus/time.h"

namespace swarm {

// std::floor calls the library where the processor's own instruction may be missing.
inline int floor_of(double value) {
  const int whole = static_cast<int>(value);
  return whole - (value < whole ? 1 : 0);
}

// Index of the voxel of the world lattice that holds a place, W [m]; far away some voxel far away.
inline Eigen::Vector3i lattice_voxel(const Eigen::Vector3d& place, double resolution_m) {
  return (place.array() / resolution_m).floor().max(-1e8).min(1e8).matrix().cast<int>();
}

// Where a window of voxels lies. Voxel i of the world lattice spans [i, i + 1) * resolution along each axis of W, so
// windows of different times share their voxels and the map never slides.
struct GridGeometry {
  double resolution_m = 0.1;
  Eigen::Vector3i origin = Eigen::Vector3i::Zero();  // world index of the window's first voxel
  Eigen::Vector3i size = Eigen::Vector3i::Zero();    // voxels along x, y, z

  // Window index of the voxel that holds world point `p` [m]; may lie outside the window.
  Eigen::Vector3i voxel_of(const Eigen::Vector3d& p) const {
    return Eigen::Vector3i(floor_of(p.x() / resolution_m), floor_of(p.y() / resolution_m),
                           floor_of(p.z() / resolution_m)) -
           origin;
  }
  // Centre of a window voxel, W [m].
  Eigen::Vector3d center_of(const Eigen::Vector3i& voxel) const {
    return ((voxel + origin).cast<double>().array() + 0.5).matrix() * resolution_m;
  }
  bool contains(const Eigen::Vector3i& v) const { return (v.array() >= 0).all() && (v.array() < size.array()).all(); }
  int words_per_column() const { return (size.z() + 63) / 64; }
  int words_per_frame() const { return size.x() * size.y() * words_per_column(); }
  bool operator==(const GridGeometry&) const = default;
};

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

// Frames of bit columns: frame-major, then x, y, then 64-bit words along z (bit k of word w is voxel z = 64 w + k).
// Bits at z >= size.z() are always zero. Remembers where it was written to, for most of a map is empty.
class Sogm {
 public:
  Utime start_utime{};        // of the first frame
  Duration frame_duration{};  // > 0
  int num_frames = 0;
  GridGeometry geometry;

  // Sets the layout and clears all voxels; keeps the allocation when it suffices.
  void reset(const GridGeometry& new_geometry, int frames, Utime start, Duration duration);

  // All words: num_frames * words_per_frame().
  const std::vector<std::uint64_t>& words() const { return words_; }
  std::span<std::uint64_t> words_to_write();

  // The words of a column, and of no other; of those to write to, whoever asks is taken to write.
  const std::uint64_t* column(int frame, int x, int y) const { return words_.data() + index_of(frame, x, y); }
  std::uint64_t* column(int frame, int x, int y) { return columns(frame, {{x, y}, {x, y}}); }
  // The first column of a box (not none) that may be written to, in this frame and all others; the others lie as in the
  // frame. What lies between them counts as written to as well.
  std::uint64_t* columns(int frame, const Columns& box);
  // A word of a frame.
  std::uint64_t* word(int frame, std::size_t index);

  // Makes a frame what the one before it is.
  void repeat_before(int frame);

  // Visits [first, end) of the words of a frame that may hold something in any frame, in order: all others are zeros.
  template <class Visit>
  void for_each_used_run(const Visit& visit) const {
    for (std::size_t i = 0; i < used_.size(); ++i) {
      for (std::uint64_t lines = used_[i]; lines != 0;) {
        const int first = std::countr_zero(lines), end = first + std::countr_one(lines >> first);
        const std::size_t begin = (64 * i + static_cast<std::size_t>(first)) * kLine;
        visit(begin, std::min(begin + static_cast<std::size_t>(end - first) * kLine, frame_words_));
        lines = end == 64 ? 0 : lines & ~std::uint64_t{0} << end;
      }
    }
  }

  // Outside the window nothing is known, hence nothing is occupied.
  bool occupied(int frame, const Eigen::Vector3i& voxel) const {
    return geometry.contains(voxel) &&
           (column(frame, voxel.x(), voxel.y())[voxel.z() >> 6] >> (voxel.z() & 63) & 1u) != 0;
  }
  Utime end_utime() const { return start_utime + num_frames * frame_duration; }  // of the last frame
  // Frame in force at `utime`, clamped to the first and the last: what lies beyond the horizon is taken to stay.
  int frame_at(Utime utime) const;

 private:
  static constexpr std::size_t kLine = 8;  // words

  std::size_t index_of(int frame, int x, int y) const {
    const Eigen::Index row = Eigen::Index{frame} * geometry.size.x() + x;
    return static_cast<std::size_t>((row * geometry.size.y() + y) * geometry.words_per_column());
  }
  void clear_used();
  void use(std::size_t first_word, std::size_t last_word);  // of a frame

  std::vector<std::uint64_t> words_;
  std::size_t frame_words_ = 0;
  std::vector<std::uint64_t> used_;  // lines of a frame that were written to in any frame, a bit each
};

// Word `w` of a column of `n` words (beyond them zeros) shifted down by `shift` bits, of either sign.
inline std::uint64_t word_of_column(const std::uint64_t* column, int n, int w, int shift) {
  const int bit = 64 * w + shift, word = bit >> 6, offset = bit & 63;
  const std::uint64_t low = word >= 0 && word < n ? column[word] >> offset : 0;
  const std::uint64_t high = offset != 0 && word + 1 >= 0 && word + 1 < n ? column[word + 1] << (64 - offset) : 0;
  return low | high;
}

// ORs what the first frame of `other` holds into every frame, as far as the windows overlap; their voxels are of one
// edge.
void add_first_frame(const Sogm& other, Sogm* sogm);

// Into `out`, one frame: the voxels of the window that are not set in a frame.
void complement(const Sogm& sogm, int frame, Sogm* out);

// Visits the words of a column of `size` voxels that hold voxels whose centres lie in [low, high] (in voxels above the
// window's first centre), each with their bits.
template <class Visit>
void for_each_word_of_run(double low, double high, int size, const Visit& visit) {
  const int first = size - static_cast<int>(size - std::clamp<double>(low, 0.0, size));  // ceil
  const int last = static_cast<int>(std::clamp<double>(high + 1.0, 0.0, size)) - 1;      // floor
  for (int w = first >> 6; w <= last >> 6; ++w) {
    const int from = std::max(first - 64 * w, 0), to = std::min(last - 64 * w, 63);
    if (from <= to) visit(w, (~std::uint64_t{0} >> (63 - (to - from))) << from);
  }
}

// Sets them.
inline void set_run(double low, double high, int size, std::uint64_t* column) {
  for_each_word_of_run(low, high, size, [column](int word, std::uint64_t bits) { column[word] |= bits; });
}

}  // namespace swarm
