// How a path of the search ends when it does not reach the goal: it brakes to rest and hovers there.
#pragma once

#include <cstdint>

#include "planner_daemon/search/search_context.h"
#include "planner_daemon/search/search_tree.h"

namespace swarm {

// Brakes to rest from a node and hovers to the end of horizon and map: visit(sample) of each sample on the
// way, until it returns false. The knots behind the node's go to `path` in any case.
struct BrakeSample {
  Utime utime;
  double duration_s;
  std::size_t word;           // of the maps' layers
  std::uint64_t blocked_bit;  // in it; 0: free
  bool strays;                // leaves the flight space
  bool meets_wall;
};
template <class Visit>
void brake(const SearchContext& context, const SearchNode& node, SearchPath* path, const Visit& visit) {
  const Primitives& primitives = context.primitives;
  const double tau_s = primitives.tau_s();
  const int brake_pieces = primitives.brake_pieces();
  ConfigurationSpace& space = *context.problem.space;
  const Sogm& map = space.grid();
  bool goes_on = true;
  const MotionState from = node.state.motion();
  const Eigen::Vector3d level = primitives.brake_level(from);
  MotionState state = from;
  for (int k = 0; k < brake_pieces; ++k) {
    const bool last = k == brake_pieces - 1;
    const Eigen::Vector3d a = primitives.brake_acceleration(k + 1, from, level);
    if (goes_on) {
      const auto samples = [&](int axis) {
        return primitives.axis_samples(axis, state.position[axis], state.velocity[axis], state.acceleration[axis],
                                       a[axis]);
      };
      const AxisSamples x = samples(0), y = samples(1), z = samples(2);
      const auto& first_words = context.first_words[static_cast<std::size_t>(node.depth + k)];
      const Sogm& blocked = space.blocked(context.first_frame(node.depth + k), context.last_frame(node.depth + k),
                                          {{x.low, y.low}, {x.high, y.high}});
      for (int i = 0; i < primitives.num_samples() && goes_on; ++i) {
        const auto at = static_cast<std::size_t>(i);
        const auto word = static_cast<std::size_t>(first_words[at] + x.offset[at] + y.offset[at] + z.offset[at]);
        goes_on = visit(BrakeSample{context.utime_of_sample(node.depth + k, i), tau_s / primitives.num_samples(), word,
                                    blocked.words()[word] & x.in_window[at] & y.in_window[at] & z.in_window[at],
                                    ((x.strays | y.strays | z.strays) >> i & 1u) != 0,
                                    space.meets_wall(x.half[at], y.half[at], z.half[at])});
      }
    }
    state = primitives.propagate(state, a);
    if (last) state.velocity.setZero(), state.acceleration.setZero();
    path->knots[static_cast<std::size_t>(node.depth + k + 1)] = state;
  }
  path->num_pieces = node.depth + brake_pieces;
  const GridGeometry& grid = map.geometry;
  const Eigen::Vector3i voxel = grid.voxel_of(state.position);
  if (!goes_on || !grid.contains(voxel)) return;
  // At rest, one look per frame is enough.
  Utime utime = context.utime_at(path->num_pieces);
  const int column = (voxel.x() * grid.size.y() + voxel.y()) * grid.words_per_column() + (voxel.z() >> 6);
  int frame = map.frame_at(utime);
  const Sogm& blocked = space.blocked(frame, map.num_frames - 1, {voxel.head<2>(), voxel.head<2>()});
  for (; goes_on && utime < context.hover_until_utime; ++frame) {
    const bool stays = frame == map.num_frames - 1;
    const Utime end = map.start_utime + (frame + 1) * map.frame_duration;
    const Utime next = stays ? context.hover_until_utime : std::min(context.hover_until_utime, end);
    const auto word = static_cast<std::size_t>(frame * context.words_per_frame + column);
    goes_on = visit(BrakeSample{utime, to_seconds(next - utime), word,
                                blocked.words()[word] & std::uint64_t{1} << (voxel.z() & 63), false, false});
    utime = next;
  }
}

// When braking from a node first meets what is blocked, or leaves the flight space; kNever: it comes to rest.
inline Utime brake_until_blocked(const SearchContext& context, const SearchNode& node, SearchPath* path) {
  Utime first_blocked = kNever;
  brake(context, node, path, [&](const BrakeSample& sample) {
    const double ahead_s = to_seconds(sample.utime - context.problem.start_utime);
    const bool leaves = context.start_blocked && ahead_s <= context.options.leave_s;
    if (((sample.blocked_bit != 0 || sample.meets_wall) && !leaves) || sample.strays) first_blocked = sample.utime;
    return first_blocked == kNever;
  });
  return first_blocked;
}

}  // namespace swarm
