#include "planner_daemon/space/configuration_space.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace swarm {
namespace {

constexpr int kTile = 4;                                      // columns along each edge of what is worked out or not
constexpr double kWallInflation = 1.3;                        // voxels
constexpr Duration kLongestStep = 10ms, kShortestStep = 1ms;  // of checks along a motion

// A peer is occupied space: like an obstacle's voxels it counts by centres, so half a voxel comes on top.
double occupied_radius_m(const Peer& peer, const Sogm& sogm) {
  return peer.radius_m + 0.5 * sogm.geometry.resolution_m;
}

// What it held stays.
void lay_out(const Sogm& like, int num_frames, Sogm* sogm) {
  if (sogm->geometry.size != like.geometry.size || sogm->num_frames != num_frames)
    sogm->reset(like.geometry, num_frames, like.start_utime, like.frame_duration);
  sogm->geometry = like.geometry;
  sogm->start_utime = like.start_utime;
  sogm->frame_duration = like.frame_duration;
}

Columns column_of(const Eigen::Vector3i& voxel) {
  return {voxel.head<2>(), voxel.head<2>()};
}

}  // namespace

void ConfigurationSpace::compose(const Sogm& sogm, const std::vector<Peer>& peers, const ReachableSet& reachable,
                                 double margin_m, const Sogm* seen) {
  margin_m_ = margin_m;
  occupancy_ = {&sogm, &peers_};
  sees_all_ = seen == nullptr;
  if (!sees_all_) {
    complement(*seen, 1, &seen_there_);
    seen_.reset(sogm.geometry, 1, sogm.start_utime, sogm.frame_duration);
    add_first_frame(seen_there_, &seen_);
  }
  add_peers(peers, reachable);
  for (Sogm* layer : {&blocked_.sogm, &emergency_.sogm, &collision_.sogm, &recently_occupied_, &inflation_})
    lay_out(sogm, sogm.num_frames, layer);
  blocked_.dilator.set(sogm.geometry, blocked_m());
  emergency_.dilator.set(sogm.geometry, options_.radius_m + options_.emergency_clearance_m);
  collision_.dilator.set(sogm.geometry, std::max(0.0, options_.radius_m - options_.collision_depth_m));
  walls_.see(seen);
  walls_.set_resolution(sogm.geometry.resolution_m);
  // What is too close to a wall although its voxel is free lies within.
  const double least_m = walls_.empty() ? 0.0 : kWallInflation * sogm.geometry.resolution_m;
  inflation_dilator_.set(sogm.geometry, std::max(options_.inflation_m, least_m));
  recent_frames_ = static_cast<int>(std::lround(options_.recently_occupied_s / to_seconds(sogm.frame_duration)));
  tiles_ = (sogm.geometry.size.head<2>().array() + kTile - 1) / kTile;
  const auto tiles = static_cast<std::size_t>(sogm.num_frames) * static_cast<std::size_t>(tiles_.prod());
  if (inflation_rounds_.size() != tiles || round_ == std::numeric_limits<std::uint32_t>::max()) {
    for (Rounds* rounds : {&blocked_.rounds, &emergency_.rounds, &collision_.rounds, &inflation_rounds_})
      rounds->assign(tiles, 0);
    round_ = certain_round_ = 0;
  }
  ++round_;
}

// Only where they keep the robot off a place it comes to, or were recently.
void ConfigurationSpace::add_peers(const std::vector<Peer>& peers, const ReachableSet& reachable) {
  const Sogm& sogm = *occupancy_.sogm;
  const double most_m =
      std::max(blocked_m(), options_.radius_m + options_.emergency_clearance_m) + options_.inflation_m;
  const int margin = static_cast<int>(std::ceil(most_m / sogm.geometry.resolution_m)) + 1;
  peers_.lay_out(sogm);
  silent_peers_.lay_out(sogm);
  bounds_.clear();
  Columns all{sogm.geometry.size.head<2>(), Eigen::Vector2i::Constant(-1)};
  for (int frame = 0; frame < sogm.num_frames; ++frame) {
    bounds_.push_back(
        reachable_columns(sogm, frame, reachable, options_.recently_occupied_s).grown(margin, sogm.geometry));
    if (bounds_.back().empty()) continue;
    all.first = all.first.cwiseMin(bounds_.back().first);
    all.last = all.last.cwiseMax(bounds_.back().last);
  }
  const Duration clock_error = to_duration(options_.clock_error_s);
  for (const Peer& peer : peers) {
    const double radius_m = occupied_radius_m(peer, sogm);
    const double widest_m = radius_m + (peer.silent ? options_.silent_peer_margin_m : 0.0);
    const Columns space{sogm.geometry.voxel_of(peer.space.min().array() - widest_m).head<2>(),
                        sogm.geometry.voxel_of(peer.space.max().array() + widest_m).head<2>()};
    if (!intersect(space, all)) continue;
    if (peer.silent) silent_peers_.add(peer.motion, widest_m, clock_error, bounds_);
    peers_.add(peer.motion, radius_m, clock_error, bounds_);
    if (!peer.pending.empty()) peers_.add({peer.motion.committed, peer.pending}, radius_m, clock_error, bounds_);
  }
}

Occupancy ConfigurationSpace::compose_standing(const std::vector<Peer>& peers) {
  const Sogm& sogm = *occupancy_.sogm;
  standing_.reset(sogm.geometry, 1, sogm.start_utime, sogm.num_frames * sogm.frame_duration);
  const std::uint64_t *first = sogm.column(0, 0, 0), *last = sogm.column(sogm.num_frames - 1, 0, 0);
  standing_words_.clear();  // little is left of the first and the last frame together
  sogm.for_each_used_run([&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if ((first[i] & last[i]) == 0) continue;
      *standing_.word(0, i) = first[i] & last[i];
      standing_words_.push_back(i);
    }
  });
  for (int frame = 1; frame + 1 < sogm.num_frames; ++frame) {
    const std::uint64_t* words = sogm.column(frame, 0, 0);
    for (const std::size_t i : standing_words_) *standing_.word(0, i) &= words[i];
  }
  if (!sees_all_)
    for (const std::size_t i : standing_words_) *standing_.word(0, i) &= seen_.words()[i];
  const Columns all = all_columns(sogm.geometry);
  standing_peers_.lay_out(standing_);
  for (const Peer& peer : peers) {
    if (peer.motion.end_utime() <= sogm.start_utime)
      standing_peers_.add(peer.motion, occupied_radius_m(peer, sogm), 0us, {&all, 1});
  }
  return {&standing_, &standing_peers_};
}

void ConfigurationSpace::add_known(const Sogm* known) {
  if (sees_all_ || known == nullptr) return;
  known_.reset(standing_.geometry, 1, standing_.start_utime, standing_.frame_duration);
  add_first_frame(*known, &known_);
  const std::span<std::uint64_t> standing = standing_.words_to_write();
  for (std::size_t i = 0; i < standing.size(); ++i) standing[i] |= known_.words()[i] & ~seen_.words()[i];
}

template <class WorkOut>
void ConfigurationSpace::for_each_new_box(int first_frame, int last_frame, const Columns& columns, Rounds* rounds,
                                          const WorkOut& work_out) {
  const Eigen::Vector2i edge = all_columns(occupancy_.sogm->geometry).last;
  if ((columns.last.array() < 0).any()) return;
  const Eigen::Vector2i first = columns.first.cwiseMax(0) / kTile, last = columns.last.cwiseMin(edge) / kTile;
  for (int frame = first_frame; frame <= last_frame; ++frame) {
    Columns box{edge, Eigen::Vector2i::Constant(-1)};  // that holds all new tiles
    for (int x = first.x(); x <= last.x(); ++x) {
      for (int y = first.y(); y <= last.y(); ++y) {
        std::uint32_t& round = (*rounds)[tile_at(frame, x, y)];
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

// Only where something is too close does it matter.
const Occupancy& ConfigurationSpace::certain() {
  if (sees_all_) return occupancy_;
  if (certain_round_ != round_) {
    certain_ = *occupancy_.sogm;
    const std::size_t n = seen_.words().size();
    const std::span<std::uint64_t> certain = certain_.words_to_write();
    for (std::size_t i = 0; i < certain.size(); ++i) certain[i] &= seen_.words()[i % n];
    certain_occupancy_ = {&certain_, &peers_};
    certain_round_ = round_;
  }
  return certain_occupancy_;
}

const Sogm& ConfigurationSpace::look(int first_frame, int last_frame, const Columns& columns, DilatedLayer* layer) {
  for_each_new_box(first_frame, last_frame, columns, &layer->rounds, [&](int frame, const Columns& box) {
    sources_.clear();
    const Occupancy& occupancy = layer == &collision_ ? certain() : occupancy_;
    occupancy.append_layers(frame, box.grown(layer->dilator.radius_voxels(), layer->sogm.geometry), &sources_);
    layer->dilator.dilate(sources_, box, layer->sogm.columns(frame, box), sources_.front().row);
  });
  return layer->sogm;
}

Eigen::AlignedBox3d ConfigurationSpace::known() const {
  const GridGeometry& grid = blocked_.sogm.geometry;
  const double rim = std::ceil(blocked_m() / grid.resolution_m - 1e-9);
  return {(grid.origin.cast<double>().array() + rim) * grid.resolution_m,
          ((grid.origin + grid.size).cast<double>().array() - rim) * grid.resolution_m};
}

const Sogm& ConfigurationSpace::blocked(int first_frame, int last_frame, const Columns& columns) {
  return look(first_frame, last_frame, columns, &blocked_);
}

ConfigurationSpace::Layers ConfigurationSpace::layers(int first_frame, int last_frame, const Columns& columns) {
  for_each_new_box(first_frame, last_frame, columns, &inflation_rounds_, [this](int frame, const Columns& box) {
    (void)blocked(frame, frame, box);
    work_out_inflation(frame, box);
  });
  return {blocked_.sogm, recently_occupied_, inflation_};
}

// Whatever moves away may turn and come back, and silent peers may step aside: that is avoided.
void ConfigurationSpace::work_out_inflation(int frame, const Columns& box) {
  const GridGeometry& grid = inflation_.geometry;
  const Columns around = box.grown(inflation_dilator_.radius_voxels(), grid);
  const Columns seen = around.grown(blocked_.dilator.radius_voxels(), grid);
  sources_.clear();
  for (int before = std::max(0, frame - recent_frames_); before <= frame; ++before)
    occupancy_.append_layers(before, seen, &sources_);
  silent_peers_.append_layers(frame, seen, &sources_);
  const std::size_t row = sources_.front().row;
  std::uint64_t* recently_occupied = recently_occupied_.columns(frame, around);
  blocked_.dilator.dilate(sources_, around, recently_occupied, row);
  const Layer source{around, recently_occupied, row};
  inflation_dilator_.dilate({&source, 1}, box, inflation_.columns(frame, box), row);
}

Severity ConfigurationSpace::severity(std::size_t word, std::uint64_t bit) {
  const GridGeometry& grid = blocked_.sogm.geometry;
  const auto per_frame = static_cast<std::size_t>(grid.words_per_frame());
  const int frame = static_cast<int>(word / per_frame);
  const int at = static_cast<int>(word % per_frame) / grid.words_per_column();
  const Eigen::Vector2i column(at / grid.size.y(), at % grid.size.y());
  if ((look(frame, frame, {column, column}, &emergency_).words()[word] & bit) == 0) return Severity::kBlocked;
  const bool collides = (look(frame, frame, {column, column}, &collision_).words()[word] & bit) != 0;
  return collides ? Severity::kCollision : Severity::kEmergency;
}

bool ConfigurationSpace::blocked_at(const Eigen::Vector3d& position, int frame) {
  const Sogm& layer = blocked_.sogm;
  const Eigen::Vector3i voxel = layer.geometry.voxel_of(position);
  if (layer.geometry.contains(voxel)) {
    const bool is_known = blocked_.rounds[tile_at(frame, voxel.x() / kTile, voxel.y() / kTile)] == round_;
    if (!is_known) (void)blocked(frame, frame, column_of(voxel));
    if (layer.occupied(frame, voxel)) return true;
  }
  return !walls_.empty() && walls_.meet(position);
}

bool ConfigurationSpace::recently_occupied_at(const Eigen::Vector3d& position, int frame) {
  const Eigen::Vector3i voxel = grid().geometry.voxel_of(position);
  return layers(frame, frame, column_of(voxel)).recently_occupied.occupied(frame, voxel) ||
         (!walls_.empty() && walls_.meet(position));
}

// What was recently there is what blocks in that frame or shortly before, and what silent peers sweep: only where there
// are such must all of it be worked out.
int ConfigurationSpace::clear_from(const Eigen::Vector3d& position, int last_frame) {
  const Columns column = column_of(grid().geometry.voxel_of(position));
  const Columns seen = column.grown(blocked_.dilator.radius_voxels(), grid().geometry);
  int clear = 0;
  for (int frame = last_frame; frame >= 0 && frame + recent_frames_ >= clear; --frame) {
    if (blocked_at(position, frame)) return std::max(clear, std::min(frame + recent_frames_, last_frame) + 1);
    sources_.clear();
    silent_peers_.append_layers(frame, seen, &sources_);
    if (!sources_.empty() && recently_occupied_at(position, frame)) clear = std::max(clear, frame + 1);
  }
  return clear;
}

std::optional<Severity> ConfigurationSpace::severity_at(const Eigen::Vector3d& position, int frame) {
  const Eigen::Vector3i voxel = grid().geometry.voxel_of(position);
  const Columns column = column_of(voxel);
  if (!walls_.empty() && walls_.meet(position)) return Severity::kCollision;
  if (!blocked(frame, frame, column).occupied(frame, voxel)) return {};
  if (!look(frame, frame, column, &emergency_).occupied(frame, voxel)) return Severity::kBlocked;
  const bool collides = look(frame, frame, column, &collision_).occupied(frame, voxel);
  return collides ? Severity::kCollision : Severity::kEmergency;
}

Utime ConfigurationSpace::first_blocked(const Motion& motion, Utime from) {
  const Sogm& map = grid();
  const Utime end = std::max(map.end_utime(), motion.end_utime());
  for (Utime t = from; t < end;) {  // one quintic after the other
    const Utime begin = t, knot = std::min(motion.next_knot_after(t), end);
    const ControlPoints points = control_points_between(motion, begin, knot);
    const double share = 1.0 / static_cast<double>((knot - begin).count());
    const double half_voxel_us =
        0.5e6 * map.geometry.resolution_m / std::max(max_speed_bound(points, to_seconds(knot - begin)), 1e-3);
    const Duration step = std::clamp(Duration(static_cast<std::int64_t>(half_voxel_us)), kShortestStep, kLongestStep);
    for (; t < knot; t += step) {
      const Eigen::Vector3d position = bezier_position(points, static_cast<double>((t - begin).count()) * share);
      if (blocked_at(position, map.frame_at(t))) return t;
    }
  }
  return kNever;
}

}  // namespace swarm
