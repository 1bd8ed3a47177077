#include "map_daemon/perception/perception_node.h"

#include <algorithm>
#include <utility>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/text.h"

namespace swarm {

using sogm_swarm::perception_status_t;

namespace {

constexpr Duration kMaxAge = 500ms;  // of scans
constexpr Duration kStatusPeriod = 1s, kSilence = 300ms;
constexpr Duration kMapPeriod = 500ms;   // the map learns so often what was seen
constexpr double kLeastMeasured = 0.02;  // of its rays; a scan of less is blind

}  // namespace

void declare(OptionSet& options, PerceptionNodeConfig& config) {
  PerceptionConfig& perception = config.perception;
  options.add("robot-id", &config.robot_id, 0, 32767, "", "this robot");
  options.add("lidar-range", &perception.scan.lidar_range_m, 1, 6.3, "m",
              "what is further from a LiDAR is not looked at");
  options.add("depth-range", &perception.scan.depth_range_m, 1, 6.3, "m", "nor what is further from a camera");
  options.add("least-range", &perception.scan.least_range_m, 0, 5, "m", "what is nearer is the robot itself");
  options.add("memory", &perception.memory_s, 0.2, 60, "s", "what was not seen for so long is unknown");
  options.add("body", &perception.body_m, 0, 3, "m", "so near to a sensor nothing is but the robot");
  options.add("begin", &perception.begin_m, 0, 3, "m", "and so near to where it begins: the robot was put there");
  options.add("static-map", &perception.static_map,
              "OctoMap file (.bt or .ot) of what stands and is no obstacle; empty: none");
  options.add(
      "explores", &perception.explores,
      "much of what is seen is a building that --static-map does not tell: it stands until it was seen to move. "
      "false: whatever is not in the map may move at any moment, and is told of at once");
  options.add("lidar-noise", &perception.scan.lidar_noise_m, 0.001, 1, "m", "standard deviation of a LiDAR's ranges");
  options.add("depth-noise", &perception.scan.depth_noise_m, 0.001, 1, "m", "standard deviation of a camera's depths");
  options.add("depth-noise-growth", &perception.scan.depth_noise_per_m, 0, 1, "1/m",
              "and by so much times the square of the depth more");
  options.add("pose-sigma", &perception.pose_m, 0, 1, "m", "standard deviation of an axis of a sensor's position");
  options.add("pose-angle-sigma", &perception.pose_rad, 0, 1, "rad", "and of how it is turned");
  options.add("obstacle-acceleration", &perception.tracks.acceleration_mps2, 0, 100, "m/s^2",
              "of obstacles, over a second: how fast what was measured of them grows old");
  options.add("obstacle-timeout", &perception.tracks.timeout_s, 0.01, 60, "s",
              "obstacles not seen for so long are forgotten");
  options.add("peer-margin", &config.peer_margin_m, 0, 2, "m",
              "what is so near to where a robot flies is that robot: three times how far poses err");
  options.add("peer-timeout", &config.peer_timeout_s, 0.05, 60, "s", "a robot not heard for so long is an obstacle");
  options.add("max-jump", &config.max_jump_m, 0.01, 100, "m", "a sensor whose pose jumps further has lost its way");
  options.add("max-speed", &config.max_speed_mps, 0.1, 100, "m/s", "of a sensor: what is faster is a jump");
  options.add(
      "map", &config.map,
      "OctoMap file (.bt) of what stands: read at the start, written at the end and when tools/map save asks for "
      "it; empty: nothing is kept");
  options.add("clock-limit", &config.clock_limit_s, 0.001, 10, "s", "messages from further in the future are refused");
}

void verify(const PerceptionNodeConfig& config) {
  const ScanConfig& scan = config.perception.scan;
  const double range_m = std::min(scan.lidar_range_m, scan.depth_range_m);
  if (scan.least_range_m < range_m) return;
  throw OptionError("least-range: " + text_of(scan.least_range_m) +
                    " m; must be below --lidar-range and --depth-range, " + text_of(range_m) + " m");
}

PerceptionNode::PerceptionNode(const PerceptionNodeConfig& config, std::int32_t boot, Stopwatch stopwatch,
                               bool publish_durations)
    : config_(config),
      stopwatch_(std::move(stopwatch)),
      publish_durations_(publish_durations),
      obstacle_headers_(config.robot_id, boot),
      space_headers_(config.robot_id, boot),
      status_headers_(config.robot_id, boot),
      robots_(config.peer_margin_m, to_duration(config.peer_timeout_s)),
      perception_(config.perception),
      kept_(config.perception.resolution_m) {
  verify(config);
  if (config.map.empty()) return;
  map_file_.emplace(config.map);
  kept_ = map_file_->read(config.perception.resolution_m);
}

PerceptionNode::~PerceptionNode() {
  if (!map_file_ || scans_ == 0) return;
  kept_.learn(perception_.seen_space());
  map_file_->finish();
  map_file_->write(kept_);
}

std::vector<Subscription> PerceptionNode::subscriptions() const {
  return {{BusId::kOnboard, channel::kDepthImage},
          {BusId::kOnboard, channel::kLidarScan},
          {BusId::kOnboard, channel::kOwnTrajectory},
          {BusId::kOnboard, channel::kPeerTrajectory},
          {BusId::kOnboard, channel::kSaveMap}};
}

void PerceptionNode::on_message(Utime now, BusId, std::string_view channel, std::span<const std::uint8_t> bytes,
                                Outbox&) {
  Refusal refusal = Refusal::kNone;
  if (channel == channel::kDepthImage) {
    refusal = on_image(now, bytes);
  } else if (channel == channel::kLidarScan) {
    refusal = on_scan(now, bytes);
  } else if (channel == channel::kOwnTrajectory || channel == channel::kPeerTrajectory) {
    refusal = on_announcement(now, channel == channel::kOwnTrajectory, bytes);
  } else if (channel == channel::kSaveMap) {
    refusal = on_map_request(now, bytes);
  }
  if (refusal != Refusal::kNone) refused_.count(refusal);
}

TimeWindow PerceptionNode::window(Utime now) const {
  return {now, kMaxAge, to_duration(config_.clock_limit_s)};
}

Refusal PerceptionNode::on_image(Utime now, std::span<const std::uint8_t> bytes) {
  const auto in_order = [this](const sogm_swarm::depth_image_t& m) {
    return sensors_[static_cast<std::size_t>(m.sensor)].images.pass(m.header);
  };
  if (const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, window(now), in_order, &image_);
      refusal != Refusal::kNone)
    return refusal;
  Sensor& sensor = sensors_[static_cast<std::size_t>(image_.sensor)];
  read_scan(image_, config_.perception.scan, config_.perception.resolution_m, &sensor.scan);
  return take(&sensor);
}

Refusal PerceptionNode::on_scan(Utime now, std::span<const std::uint8_t> bytes) {
  if (const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, window(now), AnyOrder{}, &part_);
      refusal != Refusal::kNone)
    return refusal;
  Sensor& sensor = sensors_[static_cast<std::size_t>(part_.sensor)];
  const ScanAssembler::Result result = sensor.scans.add(part_);
  if (result == ScanAssembler::Result::kRefused) return Refusal::kSequence;
  if (result == ScanAssembler::Result::kIncomplete) return Refusal::kNone;
  read_scan(sensor.scans.parts(), config_.perception.scan, config_.perception.resolution_m, &sensor.scan);
  return take(&sensor);
}

Refusal PerceptionNode::take(Sensor* sensor) {
  const RangeScan& scan = sensor->scan;
  const double since_s = std::max(to_seconds(scan.utime - sensor->utime), 0.0);
  jumped_ = sensor->has_pose && (scan.origin - sensor->position).norm() >
                                    config_.max_jump_m + config_.max_speed_mps * std::min(since_s, 1.0);
  sensor->has_pose = true;
  sensor->position = scan.origin;
  sensor->utime = scan.utime;
  sensor->is_new = false;
  if (jumped_) {  // what was seen before is somewhere else
    ++jumps_;
    perception_.forget();
    return Refusal::kInconsistent;
  }
  if (scan.measured < kLeastMeasured * scan.rays) {
    ++blind_;
    return Refusal::kNone;
  }
  sensor->is_new = true;
  return Refusal::kNone;
}

Refusal PerceptionNode::on_announcement(Utime now, bool own, std::span<const std::uint8_t> bytes) {
  sogm_swarm::announcement_t message;
  const auto from = [&](const sogm_swarm::announcement_t& m) {
    const bool good = (m.header.robot_id == config_.robot_id) == own &&
                      (announcement_gates_.contains(m.header.robot_id) ||
                       announcement_gates_.size() < static_cast<std::size_t>(kMaxRosterRobots + kMaxStrangers));
    return good ? Refusal::kNone : Refusal::kRobot;
  };
  const auto in_order = [this](const sogm_swarm::announcement_t& m) {
    return announcement_gates_[m.header.robot_id].pass(m.header);
  };
  const Refusal refusal = receive(bytes, from, {now}, in_order, &message);
  if (refusal == Refusal::kNone) robots_.hear(message, now);
  return refusal;
}

Refusal PerceptionNode::on_map_request(Utime now, std::span<const std::uint8_t> bytes) {
  sogm_swarm::map_request_t request;
  const Refusal refusal = receive(bytes, FromRobot{config_.robot_id}, window(now), map_requests_, &request);
  if (refusal == Refusal::kNone) is_map_asked_for_ = true;
  return refusal;
}

bool PerceptionNode::on_clock_step(Utime, Duration step) {
  robots_.shift(step);
  perception_.shift(step);
  last_scan_utime_ += step;
  for (Sensor& sensor : sensors_) sensor.utime += step, sensor.scan.utime += step;
  return true;
}

std::int16_t PerceptionNode::state(Utime now) const {
  if (jumped_) return perception_status_t::kNoPose;
  const bool fresh = scans_ > 0 && check_time(last_scan_utime_, now, kSilence, kSilence) == Refusal::kNone;
  return fresh ? perception_status_t::kRunning : perception_status_t::kNoScan;
}

Activity PerceptionNode::activity(Utime now) const {
  switch (state(now)) {
    case perception_status_t::kNoPose:
      return {.waits = true, .text = "waits for a sensor that knows where it is: its pose jumped"};
    case perception_status_t::kNoScan:
      return waits_for(std::string(channel::kLidarScan) + " or " + channel::kDepthImage);
    default:
      return {.text = "looks around the robot"};
  }
}

Utime PerceptionNode::step(Utime now, Outbox& outbox) {
  for (Sensor& sensor : sensors_)
    if (sensor.is_new) process(&sensor, outbox);
  if (map_file_ && is_map_asked_for_ && !map_file_->is_writing()) {
    (void)map_file_->begin_writing(kept_);
    is_map_asked_for_ = false;
  }
  if (now >= status_.due(now, kStatusPeriod)) {
    publish_status(now, outbox);
    status_.done(now);
  }
  return status_.due(now, kStatusPeriod);
}

void PerceptionNode::process(Sensor* sensor, Outbox& outbox) {
  const std::chrono::nanoseconds begun = stopwatch_ ? stopwatch_() : 0ns;
  const Utime utime = sensor->scan.utime;
  perception_.update(sensor->scan, robots_.at(utime), obstacle_headers_.next(utime));
  outbox.publish(BusId::kOnboard, channel::kObstacles, perception_.report());
  for (const sogm_swarm::sogm_t& part : encoder_.encode(perception_.seen_space(), space_headers_.next(utime)))
    outbox.publish(BusId::kOnboard, channel::kSeenSpace, part);
  if (map_file_) keep_map(utime);
  sensor->is_new = false;
  last_scan_utime_ = utime;
  ++scans_;
  if (stopwatch_) scan_ms_ = to_ms(stopwatch_() - begun);
}

void PerceptionNode::keep_map(Utime utime) {
  if (utime < map_exchange_.due(utime, kMapPeriod)) return;
  kept_.learn(perception_.seen_space());
  perception_.recall(kept_);
  map_exchange_.done(utime);
}

std::int16_t PerceptionNode::map_state() const {
  if (!map_file_) return perception_status_t::kNoMap;
  if (map_file_->has_failed()) return perception_status_t::kMapNotWritten;
  return kept_.is_full() ? perception_status_t::kMapFull : perception_status_t::kMapKept;
}

void PerceptionNode::publish_status(Utime now, Outbox& outbox) {
  perception_status_t status{};
  status.header = status_headers_.next(now);
  status.state = state(now);
  status.scans = scans_;
  status.rate_hz = static_cast<float>((scans_ - scans_at_last_status_) / to_seconds(kStatusPeriod));
  status.scan_ms = publish_durations_ ? static_cast<float>(scan_ms_) : 0.0f;
  status.points = perception_.points();
  status.masked = perception_.masked();
  for (const Track& track : perception_.tracker().tracks())
    ++(perception_.is_moving(track) ? status.moving : status.standing);
  status.jumps = jumps_;
  status.blind = blind_;
  status.map_state = map_state();
  status.map_blocks = static_cast<std::int32_t>(kept_.blocks());
  status.maps_written = map_file_ ? map_file_->written() : 0;
  refused_.copy_to(status.refused);
  outbox.publish(BusId::kOnboard, channel::kPerceptionStatus, status);
  scans_at_last_status_ = scans_;
}

}  // namespace swarm
