#include "map_daemon/map_node.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/text.h"
#include "map_daemon/dilation.h"
#include "map_daemon/octomap_file.h"

namespace swarm {

using sogm_swarm::map_status_t;
using sogm_swarm::obstacle_t;

namespace {

constexpr Duration kMaxAge = 1s;  // of messages
constexpr Duration kStatusPeriod = 1s;
constexpr std::size_t kMaxVoxelObstacles = 256;
constexpr double kBlind_s = 0.3;  // without SEEN_SPACE
constexpr double kLeastVoxel_m = 0.01;
constexpr double kReaction_s = 0.5, kBesides_m = 0.5;  // before a robot brakes; its own size, and what it keeps off

Eigen::Vector3d to_vector(const double (&v)[3]) {
  return {v[0], v[1], v[2]};
}

Obstacle to_obstacle(const sogm_swarm::obstacle_voxels_t& message) {
  Obstacle obstacle{.shape = {.kind = Shape::Kind::kVoxels, .size = {message.resolution, 0.0, 0.0}},
                    .position = to_vector(message.position),
                    .velocity = to_vector(message.velocity),
                    .utime = to_utime(message.header.utime) - to_duration(message.age_s)};
  auto& voxels = obstacle.shape.voxels;
  voxels.reserve(message.voxels.size());
  for (const auto& v : message.voxels) voxels.emplace_back(v[0], v[1], v[2]);
  // Sorted, runs along z are painted at once; duplicates would cost time only.
  std::sort(voxels.begin(), voxels.end(), [](const Eigen::Vector3i& a, const Eigen::Vector3i& b) {
    return std::lexicographical_compare(a.begin(), a.end(), b.begin(), b.end());
  });
  voxels.erase(std::unique(voxels.begin(), voxels.end()), voxels.end());
  return obstacle;
}

// Into `out`: what lies within `radius_m` of a set voxel of the only frame beside it. What looks ahead sees where it
// flies to, but not what is under it: a robot that sank into what lies below what it sees would come down to the floor.
void spread_sideways(const Sogm& in, double radius_m, Sogm* out) {
  const GridGeometry& window = in.geometry;
  out->reset(window, 1, in.start_utime, in.frame_duration);
  const int words = window.words_per_column();
  const double radius = radius_m / window.resolution_m;
  const int reach = static_cast<int>(std::min<double>(radius, window.size.head<2>().maxCoeff()));
  for (int dx = -reach; dx <= reach; ++dx) {
    for (int dy = -reach; dy <= reach; ++dy) {
      if (dx * dx + dy * dy > radius * radius + 1e-9) continue;
      const int first_y = std::max(0, -dy), last_y = std::min(window.size.y(), window.size.y() - dy) - 1;
      if (first_y > last_y) continue;
      for (int x = std::max(0, -dx); x < std::min(window.size.x(), window.size.x() - dx); ++x) {
        const std::uint64_t* from = in.column(0, x + dx, first_y + dy);
        std::uint64_t* to = out->columns(0, {{x, first_y}, {x, last_y}});
        for (int i = 0; i < (last_y - first_y + 1) * words; ++i) to[i] |= from[i];
      }
    }
  }
}

template <class... Parts>
void require(bool rule, const Parts&... parts) {
  if (rule) return;
  std::ostringstream text;
  (text << ... << parts);
  throw OptionError(text.str());
}

}  // namespace

int MapConfig::num_frames() const {
  return static_cast<int>(std::lround(horizon_s / frame_s));
}

Eigen::Vector3d MapConfig::window_m() const {
  const double stop_m = kBesides_m + v_max_mps * kReaction_s + v_max_mps * v_max_mps / (2 * a_max_mps2);
  return least_window_m.cwiseMax(Eigen::Vector3d(2 * stop_m, 2 * stop_m, 0.0));
}

Eigen::Vector3i MapConfig::voxels() const {
  return (window_m().array() / voxel_m() - 1e-6).ceil().max(1.0).matrix().cast<int>();
}

void declare(OptionSet& options, MapConfig& config) {
  options.add("robot-id", &config.robot_id, 0, 32767, "", "this robot");
  options.add("window", &config.least_window_m, 0.1, 1000, "m",
              "edges of the mapped window, centred at the robot; wider where the limits need that");
  options.add("v-max", &config.v_max_mps, 0.01, 100, "m/s",
              "speed limit per axis: the robot must be able to stop in the window");
  options.add("a-max", &config.a_max_mps2, 0.01, 1000, "m/s^2", "acceleration limit per axis");
  options.add("resolution", &config.resolution_m, 0, 1, "m",
              "voxel edge, 0.01 or more; 0: 0.1, or near it what the leaves of the static map consist of");
  options.add("frame", &config.frame_s, 0.001, 10, "s", "duration of one frame");
  options.add("horizon", &config.horizon_s, 0.001, 1280, "s", "length of the prediction, a whole number of frames");
  options.add("static-map", &config.static_map, "OctoMap file (.bt or .ot); empty: none");
  options.add("margin", &config.margin_m, 0, 10, "m",
              "voxel centres half a voxel and this close to an obstacle are occupied");
  options.add("growth", &config.growth_mps, 0, 10, "m/s", "growth of the margin with prediction time");
  options.add("max-rate", &config.max_rate_hz, 0.1, 1000, "Hz", "of maps, however fast obstacles arrive");
  options.add("min-rate", &config.min_rate_hz, 0.1, 1000, "Hz", "of maps while no obstacles arrive");
  options.add("obstacle-timeout", &config.tracks.timeout_s, 0.01, 60, "s",
              "obstacles not reported for so long are forgotten");
  options.add("obstacle-acceleration", &config.tracks.acceleration_mps2, 0, 100, "m/s^2",
              "of obstacles, over a second: how fast what was measured of them grows old");
  options.add("sensor-latency", &config.tracks.latency_s, 0, 60, "s", "age of reports that do not say theirs");
  options.add("track-margin", &config.track_margin, 0, 10, "",
              "the margin grows by so many standard deviations of an obstacle's position");
  options.add("track-growth", &config.track_growth, 0, 10, "",
              "the growth of the margin grows by so many standard deviations of its velocity");
  options.add("perception", &config.perception, "make no maps without SEEN_SPACE of the last 0.3 s");
  options.add("unknown", &config.unknown, "what was not seen: free, occupied, or near: occupied where it is near",
              [](const std::string& text) {
                if (text != "free" && text != "near" && text != "occupied")
                  throw OptionError("must be free, near or occupied");
              });
  options.add("unknown-near", &config.unknown_near_m, 0.1, 100, "m", "what is so near to the robot is near");
  options.add("unknown-beside", &config.unknown_beside_m, 0, 1, "m",
              "so near beside what was seen free it is free, too");
  options.add(
      "explores", &config.explores,
      "more may stand than the static map holds: beside what was seen free, but not above or below it, it is free");
  options.add("state-timeout", &config.state_timeout_s, 0.01, 60, "s", "no maps with an older robot state");
  options.add("clock-limit", &config.clock_limit_s, 0.001, 10, "s", "messages from further in the future are refused");
}

void verify(const MapConfig& config) {
  require(config.resolution_m == 0.0 || config.resolution_m >= kLeastVoxel_m, "resolution: ", config.resolution_m,
          " m; must be 0 or within [", kLeastVoxel_m, ", 1]");
  const bool is_for_stopping = config.window_m() != config.least_window_m;
  const std::string name =
      is_for_stopping ? "v-max: stopping takes a window of " + text_of(config.window_m()) + " m" : "window";
  for (int axis = 0; axis < 3; ++axis) {
    const double edges = config.window_m()[axis] / config.voxel_m();
    require(edges <= kMaxVoxelsPerAxis, name, ": ", edges, " voxels of --resolution ", config.voxel_m(), " m along ",
            "xyz"[axis], "; at most ", kMaxVoxelsPerAxis);
  }
  const double voxels = config.voxels().cast<double>().prod();
  require(voxels <= kMaxVoxelsPerFrame, name, ": ", voxels, " voxels; at most ", kMaxVoxelsPerFrame);
  const double frames = config.horizon_s / config.frame_s;
  require(std::abs(frames - std::round(frames)) <= 1e-6 * frames && frames > 0.5 && frames < kMaxMapFrames + 0.5,
          "horizon: ", config.horizon_s, " s are ", frames, " frames of --frame ", config.frame_s,
          " s; must be a whole number within [1, ", kMaxMapFrames, "]");
  const std::int64_t bytes =
      map_bytes({.resolution_m = config.voxel_m(), .size = config.voxels()}, config.num_frames());
  require(bytes <= kMaxMapBytes, name, ": ", bytes, " bytes over the horizon; at most ", kMaxMapBytes);
  require(config.max_rate_hz >= config.min_rate_hz, "max-rate: ", config.max_rate_hz, " Hz; must be at least min-rate ",
          config.min_rate_hz, " Hz");
}

MapNode::MapNode(const MapConfig& config, std::int32_t boot, Stopwatch stopwatch, bool publish_durations)
    : config_(config),
      stopwatch_(std::move(stopwatch)),
      publish_durations_(publish_durations),
      map_headers_(config.robot_id, boot),
      status_headers_(config.robot_id, boot),
      tracker_(config.tracks) {
  verify(config);
  if (config.static_map.empty()) return;
  const auto tree = read_octomap(config.static_map);
  if (config.resolution_m == 0.0) config_.resolution_m = StaticMap::fitting_voxel_m(tree->getResolution());
  verify(config_);
  static_map_.emplace(*tree, config.static_map, config_.voxel_m(), config_.reach_m());
}

std::vector<Subscription> MapNode::subscriptions() const {
  // Where the robot is matters once a map is made.
  return {{BusId::kOnboard, channel::kRobotState, Wakes::kNobody},
          {BusId::kOnboard, channel::kObstacles},
          {BusId::kOnboard, channel::kObstacleVoxels},
          {BusId::kOnboard, channel::kSeenSpace}};
}

void MapNode::on_message(Utime now, BusId, std::string_view channel, std::span<const std::uint8_t> bytes, Outbox&) {
  Refusal refusal = Refusal::kNone;
  if (channel == channel::kRobotState) {
    refusal = on_state(now, bytes);
  } else if (channel == channel::kObstacles) {
    refusal = on_obstacles(now, bytes);
  } else if (channel == channel::kObstacleVoxels) {
    refusal = on_voxels(now, bytes);
  } else if (channel == channel::kSeenSpace) {
    refusal = on_seen_space(now, bytes);
  }
  if (refusal != Refusal::kNone) refused_.count(refusal);
}

TimeWindow MapNode::window(Utime now) const {
  return {now, kMaxAge, to_duration(config_.clock_limit_s)};
}

Refusal MapNode::on_state(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::robot_state_t message;
  const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, window(now), state_gate_, &message);
  if (refusal != Refusal::kNone) return refusal;
  // The first map waits for obstacles as long as the least rate allows: an empty one would invite flying.
  if (!has_state_) build_.done(now - to_duration(1.0 / config_.max_rate_hz));
  has_state_ = true;
  position_ = to_vector(message.position);
  velocity_ = to_vector(message.velocity);
  state_utime_ = to_utime(message.header.utime);
  return Refusal::kNone;
}

Refusal MapNode::on_obstacles(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::obstacles_t message;
  const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, window(now), obstacle_gate_, &message);
  if (refusal != Refusal::kNone) return refusal;
  tracker_.update(message);
  obstacles_are_new_ = true;
  return Refusal::kNone;
}

Refusal MapNode::on_voxels(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::obstacle_voxels_t message;
  const auto from = [this](const sogm_swarm::obstacle_voxels_t& m) {
    if (const Refusal refusal = FromRobot{config_.robot_id}(m); refusal != Refusal::kNone) return refusal;
    const bool has_room = voxel_obstacles_.size() < kMaxVoxelObstacles || voxel_obstacles_.contains(m.id);
    return has_room ? Refusal::kNone : Refusal::kLength;
  };
  if (const Refusal refusal = receive(bytes, from, window(now), voxel_gate_, &message); refusal != Refusal::kNone)
    return refusal;
  voxel_obstacles_.insert_or_assign(message.id, VoxelObstacle{to_obstacle(message), to_utime(message.header.utime)});
  obstacles_are_new_ = true;
  return Refusal::kNone;
}

Refusal MapNode::on_seen_space(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::sogm_t part;
  if (const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, window(now), AnyOrder{}, &part);
      refusal != Refusal::kNone)
    return refusal;
  if (part.num_frames != 2 || part.resolution != config_.voxel_m()) return Refusal::kInconsistent;
  const Assembly assembly = seen_parts_.add(part, &seen_);
  if (assembly.status != AssemblyStatus::kComplete) return assembly.refusal;
  obstacles_are_new_ = true;
  return Refusal::kNone;
}

bool MapNode::fresh(Utime utime, double timeout_s, Utime now) const {
  return check_time(utime, now, to_duration(timeout_s), to_duration(config_.clock_limit_s)) == Refusal::kNone;
}

std::int16_t MapNode::state(Utime now) const {
  if (!has_state_) return map_status_t::kNoState;
  if (!fresh(state_utime_, config_.state_timeout_s, now)) return map_status_t::kStaleState;
  return config_.perception && !sees(now) ? map_status_t::kBlind : map_status_t::kRunning;
}

bool MapNode::sees(Utime now) const {
  return seen_.num_frames > 0 && fresh(seen_.start_utime, kBlind_s, now);
}

// All was where it was when it was; by which clock that is told anew.
bool MapNode::on_clock_step(Utime, Duration step) {
  state_utime_ += step;
  seen_.start_utime += step;
  tracker_.shift(step);
  for (auto& [id, entry] : voxel_obstacles_) {
    entry.obstacle.utime += step;
    entry.reported_utime += step;
  }
  return true;
}

Activity MapNode::activity(Utime now) const {
  switch (state(now)) {
    case map_status_t::kNoState:
      return waits_for(channel::kRobotState);
    case map_status_t::kStaleState:
      return waits_for(channel::kRobotState, "the last one is " + fixed(to_seconds(now - state_utime_), 1) + " s old");
    case map_status_t::kBlind:
      return waits_for(channel::kSeenSpace);
    default:
      return {.text = "makes maps around the robot"};
  }
}

Utime MapNode::step(Utime now, Outbox& outbox) {
  forget_unreported(now);
  const bool running = state(now) == map_status_t::kRunning;
  const auto next_build = [this, now] {
    return build_.due(now, to_duration(1.0 / (obstacles_are_new_ ? config_.max_rate_hz : config_.min_rate_hz)));
  };
  if (running && now >= next_build()) {
    const std::chrono::nanoseconds begun = stopwatch_ ? stopwatch_() : 0ns;
    build(now);
    publish_map(outbox);
    if (stopwatch_) build_ms_ = to_ms(stopwatch_() - begun);
  }
  if (now >= status_.due(now, kStatusPeriod)) {
    publish_status(now, outbox);
    status_.done(now);
  }
  const Utime next_status = status_.due(now, kStatusPeriod);
  return running ? std::min(next_build(), next_status) : next_status;
}

// By the time of the report, not of the measurement: what a tracker still reports it believes in, however old.
void MapNode::forget_unreported(Utime now) {
  tracker_.forget(now, to_duration(config_.clock_limit_s));
  std::erase_if(voxel_obstacles_,
                [&](const auto& entry) { return !fresh(entry.second.reported_utime, config_.tracks.timeout_s, now); });
}

void MapNode::build(Utime now) {
  const Eigen::Vector3d center = position_ + to_seconds(now - state_utime_) * velocity_;
  GridGeometry geometry{.resolution_m = config_.voxel_m(), .size = config_.voxels()};
  const Eigen::Array3d corner = center.array() / geometry.resolution_m - geometry.size.array().cast<double>() / 2;
  geometry.origin = corner.round().cast<int>();

  sogm_.reset(geometry, config_.num_frames(), now, to_duration(config_.frame_s));
  if (static_map_) static_map_->copy_into(&sogm_);
  if (sees(now)) {
    add_first_frame(seen_, &sogm_);
    if (config_.unknown != "free") add_unknown(center);
  }
  for (const Track& track : tracker_.tracks()) {
    rasterize(track.obstacle, config_.reach_m() + config_.track_margin * position_sigma_m(track, now),
              config_.growth_mps + config_.track_growth * velocity_sigma_mps(track), &sogm_);
  }
  for (const auto& [id, entry] : voxel_obstacles_)
    rasterize(entry.obstacle, config_.reach_m(), config_.growth_mps, &sogm_);
  build_.done(now);
  obstacles_are_new_ = false;
}

// What was not seen, and is not just beside what was, may be anything. What lies outside of what can be seen was not.
void MapNode::add_unknown(const Eigen::Vector3d& center) {
  complement(seen_, 1, &seen_free_);
  if (config_.explores) {
    spread_sideways(seen_free_, config_.unknown_beside_m, &beside_);
  } else {
    dilate(seen_free_, config_.unknown_beside_m, &beside_);
  }
  known_.reset(sogm_.geometry, 1, sogm_.start_utime, sogm_.frame_duration);
  add_first_frame(beside_, &known_);
  const bool only_near = config_.unknown == "near";
  const GridGeometry& window = sogm_.geometry;
  const auto set_unknown = [&](double low, double high, int x, int y) {
    for_each_word_of_run(low, high, window.size.z(), [&](int word, std::uint64_t bits) {
      bits &= ~known_.column(0, x, y)[word];
      for (int frame = 0; frame < sogm_.num_frames; ++frame) sogm_.column(frame, x, y)[word] |= bits;
    });
  };
  const double middle = center.z() / window.resolution_m - 0.5 - window.origin.z();
  for (int x = 0; x < window.size.x(); ++x) {
    for (int y = 0; y < window.size.y(); ++y) {
      const double away2 = (window.center_of({x, y, 0}) - center).head<2>().squaredNorm();
      const double square = config_.unknown_near_m * config_.unknown_near_m - away2;
      if (only_near && square <= 0.0) continue;
      const double reach = only_near ? std::sqrt(square) / window.resolution_m : window.size.z();
      set_unknown(middle - reach, middle + reach, x, y);
    }
  }
}

void MapNode::publish_map(Outbox& outbox) {
  const auto parts = encoder_.encode(sogm_, map_headers_.next(sogm_.start_utime));
  for (const sogm_swarm::sogm_t& part : parts) outbox.publish(BusId::kOnboard, channel::kSogm, part);
  if (!parts.empty()) ++maps_;  // one too large to send shows in the status: map_bytes above 3,840,000, rate 0
}

void MapNode::publish_status(Utime now, Outbox& outbox) {
  map_status_t status{};
  status.header = status_headers_.next(now);
  status.state = state(now);
  status.maps = maps_;
  status.rate_hz = static_cast<float>((maps_ - maps_at_last_status_) / to_seconds(kStatusPeriod));
  status.build_ms = publish_durations_ ? static_cast<float>(build_ms_) : 0.0f;
  status.map_bytes = encoder_.compressed_bytes();
  status.obstacles = static_cast<std::int32_t>(tracker_.tracks().size() + voxel_obstacles_.size());
  refused_.copy_to(status.refused);
  outbox.publish(BusId::kOnboard, channel::kMapStatus, status);
  maps_at_last_status_ = maps_;
}

}  // namespace swarm
