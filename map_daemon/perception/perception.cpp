// Long because the whole way from a scan to obstacles, and each reason why something is none, is to be read in one
// place.
#include "map_daemon/perception/perception.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace swarm {
namespace {

using sogm_swarm::obstacle_t;

constexpr std::int32_t kNew = -1;
constexpr double kGate_m = 0.25;  // from where a track's surface should be to points of it, besides its errors
constexpr double kMaxRadius_m = 0.8;
constexpr double kRound_rms = 2.5;  // times the noise: then it is round
constexpr double kLeastShare = 0.3,
                 kRoundShare = 0.8;  // of the points on the circle: of a track that is known, of a new one
constexpr double kCurved = 1.5, kSurelyCurved = 4.0;  // of what ends at both sides, or at one
constexpr double kSmall_m = 0.5;                      // and what is no larger may be half hidden
constexpr double kNarrow_m = 0.6, kLarge_m = 5.0;     // what is wider is no pole; and no bar, but of a building
constexpr int kThin = 3;                              // voxels of a bar, one above the other
constexpr double kLeft_m = 0.15;                      // so far from where it was seen first it moves for certain
constexpr double kRoom_m = 0.3;                       // so far above and below its place a robot that begins has room
constexpr double kFirstLook = 3.0;                    // and so many times as far, where its rays pass
constexpr double kNearby_m = 1.0;                     // nothing comes so near unseen
constexpr double kWellKnown = 40.0;                   // points that measured a radius
constexpr double kBeside_m = 0.15;                    // what is so far from a circle is something else
constexpr int kMaxRounds = 6;                         // columns that are found in one cluster
constexpr double kSlow_mps = 0.1, kClear = 2.0;       // below, or within so many standard deviations, it stands
constexpr double kCut_m = 0.1;                        // standard deviation of where something is whose side is not seen
constexpr double kUsualRadius_m = 0.25, kUsualWeight = 20.0;  // then it is taken to be about so thick
constexpr double kCutWeight = 4.0;                            // and what is known then of its radius
constexpr double kMostGate_m = 0.5;
constexpr double kTile_m = 0.8;        // what is not round and moved is taken in pieces of this size
constexpr double kShapeless_m = 0.08;  // standard deviation of where the middle of such a piece is
constexpr std::size_t kUsual = 128;    // pieces and tracks: for so many there is memory from the beginning
constexpr std::size_t kLeastPoints = 4, kFitPoints = 160;
constexpr double kWall_m = 0.15;    // what is seen so near to a wall that is known is the wall
constexpr double kAround_m = 0.15;  // surfaces so near to what moves are of it

}  // namespace

bool moves(const Track& track) {
  const double speed_mps = track.obstacle.velocity.norm();
  return speed_mps > kSlow_mps && speed_mps > kClear * velocity_sigma_mps(track);
}

Perception::Perception(const PerceptionConfig& config)
    : config_(config),
      static_map_(config.static_map.empty() ? StaticMap() : StaticMap(config.static_map, config.resolution_m, kWall_m)),
      grid_(config.resolution_m, to_duration(config.memory_s)),
      tracker_(config.tracks) {
  expected_.reserve(kUsual);
  pieces_.reserve(kUsual);
  for (sogm_swarm::obstacles_t* report : {&seen_, &report_}) report->obstacles.reserve(kUsual);
}

void Perception::update(const RangeScan& scan, std::span<const PeerMask::Ball> robots,
                        const sogm_swarm::header_t& header) {
  look(scan, robots);
  expect_tracks(scan.utime);
  pieces_.clear();
  for (const Cluster& cluster : finder_.find(grid_, surfaces_, voxels_, config_.explores)) divide(cluster, scan);
  for (sogm_swarm::obstacles_t* report : {&seen_, &report_}) {
    report->header = header;
    report->header.utime = to_us(scan.utime);
    report->complete = false;
    report->obstacles.clear();
  }
  for (const Piece& piece : pieces_) report_piece(piece, scan);
  for (sogm_swarm::obstacles_t* report : {&seen_, &report_})
    report->num_obstacles = static_cast<std::int32_t>(report->obstacles.size());
  tracker_.update(seen_);
  tracker_.forget(scan.utime, 1s);
  mark_moving();
  // Where there is a map a LiDAR's rays are taken at their word: thin things are seen in time. Who has none takes them
  // at their word only where others meet something as well, and none passed: edges of tables are met by few. A
  // camera's edges err.
  const Doubt of_lidar = config_.explores ? Doubt::kAlone : Doubt::kNowhere;
  grid_.finish(scan.utime, scan.is_image ? Doubt::kEverywhere : of_lidar);
  draw_seen_space(scan.utime);
}

void Perception::forget() {
  grid_ = FreeSpaceGrid(config_.resolution_m, to_duration(config_.memory_s));
  tracker_ = Tracker(config_.tracks);
  forms_.clear();
  has_begun_ = false;
}

void Perception::look(const RangeScan& scan, std::span<const PeerMask::Ball> robots) {
  grid_.move_to(scan.origin);
  grid_.see_free_around(scan.origin, has_begun_ ? config_.body_m : config_.begin_m, kRoom_m);
  grid_.keep_around(scan.origin, kNearby_m);
  grid_.see_free(scan.free, config_.explores && !scan.is_image);
  if (!has_begun_) grid_.see_free_along(scan.origin, kFirstLook * config_.begin_m, kRoom_m);
  has_begun_ = true;
  surfaces_.clear();
  voxels_.clear();
  points_ = static_cast<int>(scan.surfaces.size());
  masked_ = 0;
  for (const Eigen::Vector3d& place : scan.surfaces) {
    if (std::ranges::any_of(robots, [&](const PeerMask::Ball& ball) { return ball.contains(place); })) {
      ++masked_;
      continue;
    }
    const Eigen::Vector3i voxel = grid_.geometry().voxel_of(place);
    grid_.see_surface_in(voxel);
    if (!config_.static_map.empty() && static_map_.holds(place)) continue;
    surfaces_.push_back(place);
    voxels_.push_back(voxel);
  }
}

void Perception::expect_tracks(Utime utime) {
  expected_.clear();
  for (const Track& track : tracker_.tracks()) {
    const double dt_s = to_seconds(utime - track.obstacle.utime);
    const double sigma_m = position_sigma_m(track, utime);
    expected_.push_back({.id = track.id,
                         .center = (track.obstacle.position + dt_s * track.obstacle.velocity).head<2>(),
                         .gate_m = kGate_m + std::min(2.0 * sigma_m, kMostGate_m),
                         .form = &forms_[track.id]});
  }
}

void Perception::divide(const Cluster& cluster, const RangeScan& scan) {
  if (cluster.points.empty()) return;  // a wall that is known
  std::pmr::vector<const Expected*> near(&memory_);
  for (const Expected& track : expected_) {
    const double reach_m = track.form->radius.radius_m + track.gate_m;
    const Eigen::Vector2d outside =
        (cluster.low.head<2>() - track.center).cwiseMax(track.center - cluster.high.head<2>()).cwiseMax(0.0);
    if (outside.norm() <= reach_m) near.push_back(&track);
  }
  if (near.empty())
    return add_new_pieces(cluster, scan, Points(cluster.points.begin(), cluster.points.end(), &memory_));
  std::pmr::vector<Points> parts(near.size(), &memory_);
  Points rest(&memory_);
  for (const int point : cluster.points) {
    const Eigen::Vector2d place = surfaces_[static_cast<std::size_t>(point)].head<2>();
    std::size_t best = near.size();
    double nearest_m = 1e9;
    for (std::size_t i = 0; i < near.size(); ++i) {
      const double out_m = (place - near[i]->center).norm() - near[i]->form->radius.radius_m;
      const double away_m = near[i]->form->is_round ? std::abs(out_m) : std::max(out_m, 0.0);
      if (away_m > near[i]->gate_m || away_m >= nearest_m) continue;
      nearest_m = away_m;
      best = i;
    }
    (best < near.size() ? parts[best] : rest).push_back(point);
  }
  for (std::size_t i = 0; i < near.size(); ++i) {
    const auto known = std::ranges::find(pieces_, near[i]->id, &Piece::id);  // seen in another cluster
    if (known != pieces_.end()) {
      if (known->points.size() >= parts[i].size()) continue;
      pieces_.erase(known);
    }
    Piece piece{.id = near[i]->id, .points = std::move(parts[i]), .cluster = &cluster};
    if (fit_track(*near[i], scan, &piece, &rest)) pieces_.push_back(std::move(piece));
  }
  // A few points beside a track are of it.
  if (rest.size() * 4 > cluster.points.size()) add_new_pieces(cluster, scan, std::move(rest));
}

bool Perception::fit_track(const Expected& track, const RangeScan& scan, Piece* piece, Points* left) {
  if (piece->points.size() < kLeastPoints) return false;
  piece->is_cut = sides_of(piece->points, scan).free < 2;
  const double noise_m = scan.noise_at((track.center - scan.origin.head<2>()).norm());
  RoundFit fit = fit_round(seen_from_above(piece->points), scan.origin.head<2>(),
                           prior_of(track.form->radius, piece->is_cut), noise_m);
  const double share = static_cast<double>(fit.on_circle) / static_cast<double>(from_above_.size());
  piece->is_round = fit.converged && fit.rms_m <= kRound_rms * noise_m && fit.radius.radius_m <= kMaxRadius_m &&
                    (fit.center - track.center).norm() <= 2.0 * track.gate_m &&
                    share >= (track.form->is_round ? kLeastShare : kRoundShare);
  if (!piece->is_round) {  // or something stands beside it
    if (const auto found = find_round(from_above_, scan.origin.head<2>(), noise_m)) {
      const RadiusPrior& known = track.form->radius;
      // Arcs of rings are no columns; in a building, radii that were found on walls are worth nothing.
      const bool fits = config_.explores || known.weight <= kCutWeight ||
                        std::abs(found->radius.radius_m - known.radius_m) <= kBeside_m;
      piece->is_round = fits && (found->center - track.center).norm() <= 2.0 * track.gate_m;
      fit = *found;
    }
  }
  if (piece->is_round) {
    Points points = std::move(piece->points);
    piece->points.clear();
    take_round(fit, &points, piece);
    left->insert(left->end(), points.begin(), points.end());
    return piece->points.size() >= kLeastPoints && may_move(fit, scan, piece);
  }
  if (track.form->is_round && track.form->radius.weight > kWellKnown) {  // something else is there
    left->insert(left->end(), piece->points.begin(), piece->points.end());
    return false;
  }
  std::erase_if(piece->points, [&](int point) {
    const bool is_off = (surfaces_[static_cast<std::size_t>(point)].head<2>() - track.center).norm() > kTile_m;
    if (is_off) left->push_back(point);
    return is_off;
  });
  if (piece->points.size() < kLeastPoints || (config_.explores && !has_moved(piece->points))) return false;
  surround(piece);
  return true;
}

void Perception::add_new_pieces(const Cluster& cluster, const RangeScan& scan, Points points) {
  if (points.size() < kLeastPoints) return;
  const bool is_near = std::ranges::any_of(points, [&](int point) {
    return (surfaces_[static_cast<std::size_t>(point)] - scan.origin).norm() <= scan.range_m;
  });
  if (!is_near) return;
  Piece whole{.id = kNew, .points = std::move(points), .cluster = &cluster};
  if (fit_new(scan, &whole)) return pieces_.push_back(std::move(whole));
  add_rounds(cluster, scan, &whole.points);
  // What stands is drawn as it was seen.
  if (whole.points.size() < kLeastPoints) return;
  if (has_moved(whole.points) || (!config_.explores && is_alone(cluster, scan))) add_tiles(cluster, whole.points);
}

void Perception::add_rounds(const Cluster& cluster, const RangeScan& scan, Points* points) {
  for (int i = 0; i < kMaxRounds && points->size() >= kLeastPoints; ++i) {
    const std::span<const Eigen::Vector2d> places = seen_from_above(*points);
    const double noise_m = scan.noise_at((places[0] - scan.origin.head<2>()).norm());
    const std::optional<RoundFit> fit = find_round(places, scan.origin.head<2>(), noise_m);
    if (!fit) return;
    Piece piece{.id = kNew, .points = Points(&memory_), .cluster = &cluster};
    take_round(*fit, points, &piece);
    if (piece.points.size() >= kLeastPoints && may_move(*fit, scan, &piece)) pieces_.push_back(std::move(piece));
  }
}

// The points on the circle become the piece's.
void Perception::take_round(const RoundFit& fit, Points* points, Piece* piece) {
  piece->is_round = true;
  piece->center = fit.center;
  piece->sigma_m = fit.sigma_m;
  piece->radius = fit.radius;
  Points left(&memory_);
  for (const int point : *points) {
    const Eigen::Vector2d place = surfaces_[static_cast<std::size_t>(point)].head<2>();
    const bool is_on = std::abs((place - fit.center).norm() - fit.radius.radius_m) <= kBeside_m;
    (is_on ? piece->points : left).push_back(point);
  }
  *points = std::move(left);
}

void Perception::add_tiles(const Cluster& cluster, std::span<const int> points) {
  Eigen::Vector2d low = surfaces_[static_cast<std::size_t>(points[0])].head<2>(), high = low;
  for (const int point : points) {
    low = low.cwiseMin(surfaces_[static_cast<std::size_t>(point)].head<2>());
    high = high.cwiseMax(surfaces_[static_cast<std::size_t>(point)].head<2>());
  }
  const Eigen::Vector2i tiles = ((high - low) / kTile_m).array().ceil().max(1.0).matrix().cast<int>();
  std::pmr::vector<Points> parts(static_cast<std::size_t>(tiles.prod()), &memory_);
  for (const int point : points) {
    const Eigen::Vector2d place = surfaces_[static_cast<std::size_t>(point)].head<2>();
    const Eigen::Vector2i tile = ((place - low) / kTile_m).cast<int>().cwiseMin(tiles - Eigen::Vector2i::Ones());
    parts[static_cast<std::size_t>(tile.x() * tiles.y() + tile.y())].push_back(point);
  }
  for (Points& part : parts) {
    if (part.size() < kLeastPoints) continue;
    Piece piece{.id = kNew, .points = std::move(part), .cluster = &cluster};
    surround(&piece);
    pieces_.push_back(std::move(piece));
  }
}

bool Perception::fit_new(const RangeScan& scan, Piece* piece) {
  const std::span<const Eigen::Vector2d> places = seen_from_above(piece->points);
  const double noise_m = scan.noise_at((places[0] - scan.origin.head<2>()).norm());
  piece->is_cut = sides_of(piece->points, scan).free < 2;
  const RoundFit fit = fit_round(places, scan.origin.head<2>(), prior_of({}, piece->is_cut), noise_m);
  const double share = static_cast<double>(fit.on_circle) / static_cast<double>(from_above_.size());
  piece->is_round =
      fit.converged && fit.rms_m <= kRound_rms * noise_m && fit.radius.radius_m <= kMaxRadius_m && share >= kRoundShare;
  piece->center = fit.center;
  piece->sigma_m = fit.sigma_m;
  piece->radius = fit.radius;
  return piece->is_round && may_move(fit, scan, piece);
}

bool Perception::has_moved(std::span<const int> points) const {
  return 2 * std::ranges::count_if(points, [this](int point) { return finder_.has_moved(point); }) >=
         std::ssize(points);
}

// It hangs together with nothing else: it is seen to end on both sides, and is narrow, or ends above and below.
bool Perception::is_alone(const Cluster& cluster, const RangeScan& scan) const {
  const double wide_m = (cluster.high - cluster.low).head<2>().norm();
  const bool ends = 2 * cluster.open_above <= cluster.num_columns && 2 * cluster.open_below <= cluster.num_columns;
  const bool is_thin = ends && cluster.voxels <= kThin * cluster.num_columns;
  return wide_m <= (is_thin ? kLarge_m : kNarrow_m) && sides_of(cluster.points, scan).free == 2;
}

// Walls are full of what could be a side of a column: what was always there must be seen to end.
bool Perception::may_move(const RoundFit& fit, const RangeScan& scan, Piece* piece) {
  const Sides sides = sides_of(piece->points, scan);
  piece->is_cut = sides.free < 2;
  if (!config_.explores || has_moved(piece->points)) return true;
  const double curved = curvature(seen_from_above(piece->points), fit);
  if (sides.free == 2) return curved > kCurved;
  const Eigen::Vector3d size = piece->cluster->high - piece->cluster->low;
  return sides.free == 1 && (sides.out_of_view > 0 || curved > kSurelyCurved || size.head<2>().norm() < kSmall_m);
}

// What stands is seen in other parts from every place, and these seem to move. What has gone is seen through where it
// was, all across its middle.
bool Perception::has_left(const Piece& piece, const Form& form) const {
  const auto track = std::ranges::find(tracker_.tracks(), piece.id, &Track::id);
  if (track == tracker_.tracks().end() || !moves(*track) || (piece.center - form.first).norm() < kLeft_m) return false;
  const GridGeometry& window = grid_.geometry();
  const Eigen::Vector3i voxel = window.voxel_of({form.first.x(), form.first.y(), form.first_height_m});
  if (!window.contains(voxel.array() - 1) || !window.contains(voxel.array() + 1)) return false;
  const std::uint64_t around = std::uint64_t{7} << (voxel.z() - 1);
  for (int x = voxel.x() - 1; x <= voxel.x() + 1; ++x) {
    for (int y = voxel.y() - 1; y <= voxel.y() + 1; ++y) {
      const int column = grid_.column_of(x, y);
      if ((grid_.surfaces(column) & around) != 0 || (grid_.free(column) & around) == 0) return false;
    }
  }
  return true;
}

// A circle around all of it.
void Perception::surround(Piece* piece) {
  const std::span<const Eigen::Vector2d> places = seen_from_above(piece->points);
  Eigen::Vector2d low = places[0], high = places[0];
  for (const Eigen::Vector2d& place : places) low = low.cwiseMin(place), high = high.cwiseMax(place);
  piece->center = 0.5 * (low + high);
  double radius_m = 0.0;
  for (const Eigen::Vector2d& place : places) radius_m = std::max(radius_m, (place - piece->center).norm());
  piece->radius = {radius_m, 0.0};
  piece->sigma_m = kShapeless_m;
  piece->is_round = false;
}

std::span<const Eigen::Vector2d> Perception::seen_from_above(std::span<const int> points) {
  from_above_.clear();
  const std::size_t every = points.size() / kFitPoints + 1;
  for (std::size_t i = 0; i < points.size(); i += every)
    from_above_.push_back(surfaces_[static_cast<std::size_t>(points[i])].head<2>());
  return from_above_;
}

Perception::Sides Perception::sides_of(std::span<const int> points, const RangeScan& scan) const {
  const auto place = [this](int point) -> const Eigen::Vector3d& { return surfaces_[static_cast<std::size_t>(point)]; };
  const Eigen::Vector2d ahead = (place(points[points.size() / 2]) - scan.origin).head<2>().normalized();
  const Eigen::Vector2d aside(-ahead.y(), ahead.x());
  int right = points[0], left = right;
  double least_m = std::numeric_limits<double>::infinity(), most_m = -least_m;
  for (const int point : points) {
    const double aside_m = aside.dot(place(point).head<2>() - scan.origin.head<2>());
    if (aside_m < least_m) least_m = aside_m, right = point;
    if (aside_m >= most_m) most_m = aside_m, left = point;
  }
  const GridGeometry& window = grid_.geometry();
  Sides sides;
  const auto look_beside = [&](const Eigen::Vector3d& end, const Eigen::Vector2d& way) {
    bool free = false, out_of_view = false;
    for (const double beside_m : {kAround_m, kAround_m + window.resolution_m}) {
      Eigen::Vector3d beside = end;
      beside.head<2>() += beside_m * way;
      const Eigen::Vector3i voxel = window.voxel_of(beside);
      if (!window.contains(voxel)) continue;
      const std::uint64_t around = std::uint64_t{0x1f} << std::max(voxel.z() - 2, 0);
      const int column = grid_.column_of(voxel.x(), voxel.y());
      free = free || (grid_.free(column) & around) != 0;
      out_of_view = out_of_view || !scan.sees(beside);
    }
    if (free) {
      ++sides.free;
    } else if (out_of_view) {
      ++sides.out_of_view;
    }
  };
  look_beside(place(left), aside);
  look_beside(place(right), -aside);
  return sides;
}

RadiusPrior Perception::prior_of(const RadiusPrior& known, bool cut) {
  if (known.weight > kCutWeight) return known;
  return cut ? RadiusPrior{kUsualRadius_m, kUsualWeight} : RadiusPrior{};
}

void Perception::report_piece(const Piece& piece, const RangeScan& scan) {
  Form form = piece.id == kNew ? Form{} : forms_[piece.id];
  double sigma_m = piece.sigma_m;
  const bool is_unsure = piece.is_cut && form.radius.weight <= kCutWeight;
  if (is_unsure) sigma_m = std::max(sigma_m, kCut_m);

  form.is_round = piece.is_round;
  form.radius = piece.radius;
  if (is_unsure) form.radius.weight = std::min(form.radius.weight, kCutWeight);

  double top_m = -1e9, bottom_m = 1e9;
  for (const int point : piece.points) {
    top_m = std::max(top_m, surfaces_[static_cast<std::size_t>(point)].z());
    bottom_m = std::min(bottom_m, surfaces_[static_cast<std::size_t>(point)].z());
  }
  const GridGeometry& window = grid_.geometry();
  if (2 * piece.cluster->open_above <= piece.cluster->num_columns) {
    form.top_m = form.has_top ? std::max(form.top_m, top_m) : top_m;
    form.has_top = true;
  }
  if (2 * piece.cluster->open_below <= piece.cluster->num_columns) {
    form.bottom_m = form.has_bottom ? std::min(form.bottom_m, bottom_m) : bottom_m;
    form.has_bottom = true;
  }
  const double highest_m = (window.origin.z() + window.size.z()) * window.resolution_m;
  const double lowest_m = window.origin.z() * window.resolution_m;
  top_m = form.has_top ? std::max(form.top_m, top_m) : std::max(highest_m, top_m);
  bottom_m = form.has_bottom ? std::min(form.bottom_m, bottom_m) : std::min(lowest_m, bottom_m);

  const double away_m = (piece.center - scan.origin.head<2>()).norm(), turned_m = config_.pose_rad * away_m;
  obstacle_t obstacle{};
  obstacle.id = piece.id == kNew ? next_id_++ : piece.id;
  obstacle.shape = obstacle_t::kColumn;
  Eigen::Map<Eigen::Vector3d>(obstacle.position) << piece.center, 0.5 * (top_m + bottom_m);
  obstacle.size[0] = 2.0 * form.radius.radius_m, obstacle.size[1] = top_m - bottom_m;
  obstacle.position_sigma =
      static_cast<float>(std::sqrt(sigma_m * sigma_m + config_.pose_m * config_.pose_m + turned_m * turned_m));
  obstacle.velocity_sigma = -1.0f;
  if (piece.id == kNew) {
    form.first = piece.center;
    form.first_height_m = surfaces_[static_cast<std::size_t>(piece.points[piece.points.size() / 2])].z();
  }
  seen_.obstacles.push_back(obstacle);
  const bool has_gone = has_left(piece, form), was_told = std::exchange(form.is_told, false);
  form.moved = form.moved || has_gone || has_moved(piece.points);
  form.is_told = !config_.explores || form.moved;
  if (has_gone && !was_told) {  // how fast is known already
    const Track& track = *std::ranges::find(tracker_.tracks(), piece.id, &Track::id);
    Eigen::Map<Eigen::Vector3d>(obstacle.velocity) = track.obstacle.velocity;
    obstacle.velocity_sigma = static_cast<float>(velocity_sigma_mps(track));
  }
  if (form.is_told) report_.obstacles.push_back(obstacle);
  forms_[obstacle.id] = form;
}

void Perception::mark_moving() {
  std::erase_if(forms_, [this](const auto& entry) {
    return std::ranges::none_of(tracker_.tracks(), [&](const Track& track) { return track.id == entry.first; });
  });
  moving_points_.clear();
  for (std::size_t i = 0; i < pieces_.size(); ++i) {
    const auto track = std::ranges::find(tracker_.tracks(), seen_.obstacles[i].id, &Track::id);
    if (track == tracker_.tracks().end() || !is_moving(*track)) continue;
    for (const int point : pieces_[i].points) {
      grid_.mark_moving_in(voxels_[static_cast<std::size_t>(point)]);
      moving_points_.push_back(surfaces_[static_cast<std::size_t>(point)]);
    }
  }
}

void Perception::draw_seen_space(Utime utime) {
  seen_space_.reset(grid_.geometry(), 2, utime, 100ms);
  for (int x = 0; x < FreeSpaceGrid::kEdge; ++x) {
    for (int y = 0; y < FreeSpaceGrid::kEdge; ++y) {
      const int column = grid_.column_of(x, y);
      const std::uint64_t occupied = grid_.occupied(column);
      *seen_space_.column(0, x, y) = occupied;
      *seen_space_.column(1, x, y) = ~(grid_.seen(column) | occupied);
    }
  }
  // What moves is drawn by its track: its surfaces of a moment ago are no walls. But what has stood is none of them,
  // and what is out of sight may be anywhere.
  const GridGeometry& window = grid_.geometry();
  for (const Track& track : tracker_.tracks()) {
    if (!is_moving(track) || track.last_utime != utime) continue;
    const double dt_s = to_seconds(utime - track.obstacle.utime);
    const Eigen::Vector3d center = track.obstacle.position + dt_s * track.obstacle.velocity;
    const double reach_m = track.obstacle.shape.size.x() / 2 + kAround_m, half_m = track.obstacle.shape.size.y() / 2;
    const Eigen::Vector3i low = window.voxel_of(center - Eigen::Vector3d(reach_m, reach_m, half_m + kAround_m));
    const Eigen::Vector3i high = window.voxel_of(center + Eigen::Vector3d(reach_m, reach_m, half_m + kAround_m));
    for (int x = std::max(low.x(), 0); x <= std::min(high.x(), FreeSpaceGrid::kEdge - 1); ++x) {
      for (int y = std::max(low.y(), 0); y <= std::min(high.y(), FreeSpaceGrid::kEdge - 1); ++y) {
        const Eigen::Vector3d place = window.center_of({x, y, 0});
        if ((place - center).head<2>().norm() > reach_m) continue;
        const std::uint64_t stood = grid_.lasting(grid_.column_of(x, y));
        for_each_word_of_run(low.z(), high.z(), window.size.z(),
                             [&](int word, std::uint64_t bits) { seen_space_.column(0, x, y)[word] &= ~bits | stood; });
      }
    }
  }
}

}  // namespace swarm
