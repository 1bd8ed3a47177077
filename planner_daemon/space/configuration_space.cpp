#include "planner_daemon/space/configuration_space.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace swarm {
namespace {

constexpr int kTile = 4;  // columns along each edge of what is worked out or not
constexpr std::int64_t kCheckStep_us = 10'000, kTouchStep_us = 20'000;

double peer_reach_m(const Peer& peer, const Sogm& sogm) {
  return peer.radius_m + 0.5 * sogm.geometry.resolution_m;
}

// What it held stays.
void lay_out(const Sogm& like, int num_frames, Sogm* sogm) {
  if (sogm->geometry.size != like.geometry.size || sogm->num_frames != num_frames)
    sogm->reset(like.geometry, num_frames, like.start_utime, like.frame_duration_us);
  sogm->geometry = like.geometry;
  sogm->start_utime = like.start_utime;
  sogm->frame_duration_us = like.frame_duration_us;
}

}  // namespace

Eigen::AlignedBox3d space_of(const Motion& motion, const Trajectory& announced) {
  Eigen::AlignedBox3d space;
  for (const Trajectory* trajectory : {&motion.committed, &motion.next, &announced}) {
    for (int k = 0; k < trajectory->num_pieces(); ++k) {
      const ControlPoints points =
          quintic_control_points(trajectory->knot(k), trajectory->knot(k + 1), trajectory->piece_s());
      space.extend(points.rowwise().minCoeff()).extend(points.rowwise().maxCoeff());
    }
  }
  return space;
}

std::int64_t first_touch(const Sogm& sogm, const Motion& motion, double radius_m, std::int64_t from_utime,
                         std::int64_t until_utime) {
  const GridGeometry& grid = sogm.geometry;
  const double reach = radius_m / grid.resolution_m;
  const auto touches = [&](const Eigen::Vector3d& position, int frame) {
    const Eigen::Vector3d at =  // in voxels from the window's first centre
        (position / grid.resolution_m - grid.origin.cast<double>()).array() - 0.5;
    const Eigen::Vector2i low = (at.head<2>().array() - reach).ceil().cast<int>().cwiseMax(0);
    const Eigen::Vector2i high =
        (at.head<2>().array() + reach).floor().cast<int>().cwiseMin(grid.size.head<2>().array() - 1);
    std::uint64_t any = 0;
    for (int x = low.x(); x <= high.x(); ++x) {
      for (int y = low.y(); y <= high.y(); ++y) {
        const double high2 = reach * reach - (x - at.x()) * (x - at.x()) - (y - at.y()) * (y - at.y());
        if (high2 < 0.0) continue;
        const std::uint64_t* column = sogm.column(frame, x, y);
        for_each_word_of_run(at.z() - std::sqrt(high2), at.z() + std::sqrt(high2), grid.size.z(),
                             [&](int word, std::uint64_t bits) { any |= column[word] & bits; });
      }
    }
    return any != 0;
  };
  for (std::int64_t t = from_utime; t <= until_utime; t += kTouchStep_us) {
    if (touches(motion.at(t).position, sogm.frame_at(t))) return t;
  }
  return std::numeric_limits<std::int64_t>::max();
}

void Zones::compose(const Sogm& sogm, const std::vector<Peer>& peers, const Reach& reach) {
  occupancy_ = {&sogm, &peers_};
  add_peers(peers, reach);
  for (Sogm* zone : {&blocked_, &tight_, &contact_, &wake_, &near_}) lay_out(sogm, sogm.num_frames, zone);
  blocked_dilator_.set(sogm.geometry, options_.blocked_m());
  near_dilator_.set(sogm.geometry, options_.comfort_m);
  tight_dilator_.set(sogm.geometry, options_.radius_m + options_.tight_m);
  contact_dilator_.set(sogm.geometry, std::max(0.0, options_.radius_m - options_.contact_m));
  frames_back_ = static_cast<int>(std::llround(1e6 * options_.wake_s / static_cast<double>(sogm.frame_duration_us)));
  emergency_ = false;
  tiles_ = (sogm.geometry.size.head<2>().array() + kTile - 1) / kTile;
  const auto tiles = static_cast<std::size_t>(sogm.num_frames) * static_cast<std::size_t>(tiles_.prod());
  if (blocked_rounds_.size() != tiles || round_ == std::numeric_limits<std::uint32_t>::max()) {
    for (auto* rounds : {&blocked_rounds_, &near_rounds_, &emergency_rounds_}) rounds->assign(tiles, 0);
    round_ = 0;
  }
  ++round_;
}

// Only where they keep the robot off a place it comes to, or leave their wake there.
void Zones::add_peers(const std::vector<Peer>& peers, const Reach& reach) {
  const Sogm& sogm = *occupancy_.sogm;
  const double most_m = options_.radius_m + std::max(options_.clearance_m, options_.tight_m) + options_.comfort_m;
  const int margin = static_cast<int>(std::ceil(most_m / sogm.geometry.resolution_m)) + 1;
  peers_.lay_out(sogm);
  berths_.lay_out(sogm);
  bounds_.clear();
  Columns all{sogm.geometry.size.head<2>(), Eigen::Vector2i::Constant(-1)};
  for (int frame = 0; frame < sogm.num_frames; ++frame) {
    bounds_.push_back(reached(sogm, frame, reach, options_.wake_s).grown(margin, sogm.geometry));
    if (bounds_.back().empty()) continue;
    all.first = all.first.cwiseMin(bounds_.back().first);
    all.last = all.last.cwiseMax(bounds_.back().last);
  }
  const std::int64_t error_us = std::llround(1e6 * options_.clock_error_s);
  for (const Peer& peer : peers) {
    const double reach_m = peer_reach_m(peer, sogm);
    const double widest_m = reach_m + (peer.silent ? options_.berth_m : 0.0);
    const Columns space{sogm.geometry.voxel_of(peer.space.min().array() - widest_m).head<2>(),
                        sogm.geometry.voxel_of(peer.space.max().array() + widest_m).head<2>()};
    if (!intersect(space, all)) continue;
    if (peer.silent) berths_.add(peer.motion, widest_m, error_us, bounds_);
    peers_.add(peer.motion, reach_m, error_us, bounds_);
    if (!peer.announced.empty()) peers_.add({peer.motion.committed, peer.announced}, reach_m, error_us, bounds_);
  }
}

Occupancy Zones::compose_standing(const std::vector<Peer>& peers) {
  const Sogm& sogm = *occupancy_.sogm;
  lay_out(sogm, 1, &still_);
  still_.frame_duration_us = sogm.num_frames * sogm.frame_duration_us;
  const auto n = static_cast<std::size_t>(sogm.geometry.words_per_frame());
  const std::uint64_t *first = sogm.column(0, 0, 0), *last = sogm.column(sogm.num_frames - 1, 0, 0);
  still_words_.clear();  // little is left of the first and the last frame together
  for (std::size_t i = 0; i < n; ++i) {
    still_.words[i] = first[i] & last[i];
    if (still_.words[i] != 0) still_words_.push_back(i);
  }
  for (int frame = 1; frame + 1 < sogm.num_frames; ++frame) {
    const std::uint64_t* words = sogm.column(frame, 0, 0);
    for (const std::size_t i : still_words_) still_.words[i] &= words[i];
  }
  const Columns all = all_columns(sogm.geometry);
  standing_peers_.lay_out(still_);
  for (const Peer& peer : peers) {
    if (peer.motion.end_utime() <= sogm.start_utime)
      standing_peers_.add(peer.motion, peer_reach_m(peer, sogm), 0, {&all, 1});
  }
  return {&still_, &standing_peers_};
}

template <class WorkOut>
void Zones::for_each_new_box(int first_frame, int last_frame, const Columns& columns,
                             std::vector<std::uint32_t>* rounds, const WorkOut& work_out) {
  const Eigen::Vector2i edge = all_columns(occupancy_.sogm->geometry).last;
  if ((columns.last.array() < 0).any()) return;
  const Eigen::Vector2i first = columns.first.cwiseMax(0) / kTile, last = columns.last.cwiseMin(edge) / kTile;
  for (int frame = first_frame; frame <= last_frame; ++frame) {
    Columns box{edge, Eigen::Vector2i::Constant(-1)};  // that holds all new tiles
    for (int x = first.x(); x <= last.x(); ++x) {
      for (int y = first.y(); y <= last.y(); ++y) {
        std::uint32_t& round = (*rounds)[static_cast<std::size_t>((frame * tiles_.x() + x) * tiles_.y() + y)];
        if (round == round_) continue;
        round = round_;
        const Eigen::Vector2i corner(kTile * x, kTile * y);
        box.first = box.first.cwiseMin(corner);
        box.last = box.last.cwiseMax((corner.array() + kTile - 1).matrix().cwiseMin(edge));
      }
    }
    if (!box.empty()) work_out(frame, box);
  }
}

void Zones::prepare_blocked(int first_frame, int last_frame, const Columns& columns) {
  for_each_new_box(first_frame, last_frame, columns, &blocked_rounds_,
                   [this](int frame, const Columns& box) { dilate(frame, box, &blocked_dilator_, &blocked_); });
  if (!emergency_) return;
  for_each_new_box(first_frame, last_frame, columns, &emergency_rounds_, [this](int frame, const Columns& box) {
    dilate(frame, box, &tight_dilator_, &tight_);
    dilate(frame, box, &contact_dilator_, &contact_);
  });
}

void Zones::prepare(int first_frame, int last_frame, const Columns& columns) {
  if (emergency_) prepare_blocked(first_frame, last_frame, columns);
  for_each_new_box(first_frame, last_frame, columns, &near_rounds_, [this](int frame, const Columns& box) {
    prepare_blocked(frame, frame, box);
    work_out_near(frame, box);
  });
}

void Zones::dilate(int frame, const Columns& box, Dilator* dilator, Sogm* zone) {
  layers_.clear();
  occupancy_.append_layers(frame, box.grown(dilator->reach(), zone->geometry), &layers_);
  dilator->dilate(layers_, box, zone->column(frame, box.first.x(), box.first.y()), layers_.front().row);
}

// Whatever moves away may turn and come back, and silent peers may step aside: that is avoided.
void Zones::work_out_near(int frame, const Columns& box) {
  const GridGeometry& grid = near_.geometry;
  const Columns around = box.grown(near_dilator_.reach(), grid), seen = around.grown(blocked_dilator_.reach(), grid);
  layers_.clear();
  for (int before = std::max(0, frame - frames_back_); before <= frame; ++before)
    occupancy_.append_layers(before, seen, &layers_);
  berths_.append_layers(frame, seen, &layers_);
  const std::size_t row = layers_.front().row;
  std::uint64_t* wake = wake_.column(frame, around.first.x(), around.first.y());
  blocked_dilator_.dilate(layers_, around, wake, row);
  const Layer wake_layer{around, wake, row};
  near_dilator_.dilate({&wake_layer, 1}, box, near_.column(frame, box.first.x(), box.first.y()), row);
}

bool Zones::blocked_at(const Eigen::Vector3d& position, std::int64_t utime) {
  const int frame = blocked_.frame_at(utime);
  const Eigen::Vector3i voxel = blocked_.geometry.voxel_of(position);
  prepare_blocked(frame, frame, {voxel.head<2>(), voxel.head<2>()});
  return blocked_.occupied(frame, voxel);
}

std::int64_t Zones::first_blocked(const Motion& motion, std::int64_t from_utime) {
  const std::int64_t map_end = blocked_.start_utime + blocked_.num_frames * blocked_.frame_duration_us;
  const std::int64_t end = std::max(map_end, motion.end_utime());
  for (std::int64_t t = from_utime; t < end;) {  // one quintic after the other
    const std::int64_t begin = t, knot = std::min(motion.next_knot_after(t), end);
    const ControlPoints points = control_points_between(motion, begin, knot);
    const double share = 1.0 / static_cast<double>(knot - begin);
    for (; t < knot; t += kCheckStep_us) {
      if (blocked_at(bezier_position(points, static_cast<double>(t - begin) * share), t)) return t;
    }
  }
  return std::numeric_limits<std::int64_t>::max();
}

}  // namespace swarm
