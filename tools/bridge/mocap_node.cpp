#include "tools/bridge/mocap_node.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/crc32.h"
#include "lcmtypes/bus/limits.h"
#include "lcmtypes/bus/text.h"

namespace swarm {
namespace {

using nlohmann::json;
using sogm_swarm::obstacle_t;

constexpr double kWindow_s = 0.2;      // of velocities
constexpr double kLeastSpan_s = 0.03;  // a velocity needs so much of it
constexpr Duration kGone = 500ms;
constexpr double kRestart_s = 1.0;  // no datagram is that late: the clock began anew
constexpr double kFarthest_m = 1e4, kMaxTime_s = 1e11;
constexpr double kJump_m = 0.3, kJump_mps = 20.0;  // what moves faster is another body
constexpr std::size_t kMaxBodies = 1024, kMaxName = 64;

struct Refused {
  MocapRefusal reason;
  std::string words;
};

[[noreturn]] void refuse(MocapRefusal reason, std::string words) {
  throw Refused{reason, std::move(words)};
}

const json& field(const json& object, const char* name, const std::string& of) {
  if (!object.is_object()) refuse(MocapRefusal::kFields, of + ": must be an object");
  const auto found = object.find(name);
  if (found == object.end()) refuse(MocapRefusal::kFields, of + ": has no \"" + name + "\"");
  return *found;
}

template <int n>
Eigen::Matrix<double, n, 1> numbers(const json& array, double bound, const std::string& of) {
  const bool good = array.is_array() && array.size() == n &&
                    std::all_of(array.begin(), array.end(), [](const json& value) { return value.is_number(); });
  if (!good) refuse(MocapRefusal::kFields, of + ": must be " + std::to_string(n) + " numbers");
  Eigen::Matrix<double, n, 1> values;
  for (int i = 0; i < n; ++i) values[i] = array[static_cast<std::size_t>(i)].get<double>();
  if (!(values.array().abs() <= bound).all()) refuse(MocapRefusal::kValue, of + ": out of range");
  return values;
}

// Numbers within [low, high] separated by commas; empty when any is not.
std::vector<double> read_numbers(const std::string& text, double low, double high) {
  std::vector<double> values;
  for (const std::string& part : split(text, ',')) {
    double value = 0.0;
    const auto [stop, error] = std::from_chars(part.data(), part.data() + part.size(), value);
    if (error != std::errc() || stop != part.data() + part.size() || !(value >= low && value <= high)) return {};
    values.push_back(value);
  }
  return values;
}

ObstacleRule parse_rule(const std::string& text) {
  struct Kind {
    const char* name;
    std::int16_t shape;
    std::size_t sizes;
  };
  constexpr Kind kKinds[] = {{"column", obstacle_t::kColumn, 2},
                             {"ring", obstacle_t::kRing, 2},
                             {"box", obstacle_t::kBox, 3},
                             {"sphere", obstacle_t::kSphere, 1}};
  const auto bad = [&](const std::string& rule) { throw OptionError("'" + text + "': " + rule); };
  const std::vector<std::string> parts = split(text, ':');
  if (parts.size() < 3 || parts.size() > 4 || parts[0].empty()) bad("must be NAME:SHAPE:SIZES[:OFFSET]");
  const auto* const kind = std::ranges::find(kKinds, parts[1], &Kind::name);
  if (kind == std::end(kKinds)) bad("the shape must be column, ring, box or sphere");
  const std::vector<double> sizes = read_numbers(parts[2], 0.001, 1000.0);
  if (sizes.size() != kind->sizes)
    bad("a " + parts[1] + " has " + std::to_string(kind->sizes) + " sizes, each within [0.001, 1000] m");
  ObstacleRule rule;
  rule.name = parts[0];
  rule.shape = kind->shape;
  std::ranges::copy(sizes, rule.size.data());
  if (parts.size() == 4) {
    const std::vector<double> offset = read_numbers(parts[3], -1000.0, 1000.0);
    if (offset.size() != 3) bad("the offset must be X,Y,Z, each within [-1000, 1000] m");
    rule.offset = Eigen::Vector3d::Map(offset.data());
  }
  return rule;
}

// The same for the same name, always.
std::int32_t id_of(const std::string& name) {
  const std::span bytes(reinterpret_cast<const std::uint8_t*>(name.data()), name.size());
  return static_cast<std::int32_t>(crc32(bytes) & 0x7FFFFFFF);
}

}  // namespace

bool ObstacleRule::matches(const std::string& body) const {
  return name.ends_with('*') ? body.starts_with(std::string_view(name).substr(0, name.size() - 1)) : body == name;
}

std::vector<ObstacleRule> parse_obstacle_rules(const std::string& text) {
  std::vector<ObstacleRule> rules;
  if (text.empty()) return rules;
  for (const std::string& part : split(text, ';')) rules.push_back(parse_rule(part));
  return rules;
}

void declare(OptionSet& options, MocapConfig& config) {
  options.add("robot-id", &config.robot_id, 0, 32767, "", "this robot");
  options.add("body", &config.body, "name of the robot's own body; none: no ROBOT_STATE is published");
  options.add("obstacles", &config.obstacles,
              "bodies that are obstacles, as NAME:SHAPE:SIZES[:OFFSET];... with column:DIAMETER,HEIGHT, "
              "ring:RADIUS,TUBE, box:LENGTH,WIDTH,HEIGHT or sphere:DIAMETER [m]; NAME may end in '*'; OFFSET is X,Y,Z "
              "from the body's origin to the shape's centre",
              [](const std::string& text) { (void)parse_obstacle_rules(text); });
  options.add("delay", &config.delay_s, 0, 1, "s", "from a measurement to its arrival here");
  options.add("obstacle-rate", &config.obstacle_rate_hz, 1, 1000, "Hz", "of OBSTACLES, at most");
}

const char* to_string(MocapRefusal reason) {
  switch (reason) {
    case MocapRefusal::kJson:
      return "no JSON";
    case MocapRefusal::kFields:
      return "fields";
    case MocapRefusal::kValue:
      return "value";
    case MocapRefusal::kTwice:
      return "twice";
    case MocapRefusal::kOld:
      return "old";
  }
  return "?";
}

MocapNode::MocapNode(const MocapConfig& config, std::int32_t boot)
    : config_(config),
      rules_(parse_obstacle_rules(config.obstacles)),
      state_headers_(config.robot_id, boot),
      obstacle_headers_(config.robot_id, boot) {}

void MocapNode::on_datagram(Utime now, std::span<const std::uint8_t> bytes, Outbox& outbox) {
  try {
    const Datagram datagram = read(bytes);
    follow_clock(datagram);
    const double t_s = datagram.t_s.value_or(to_seconds(now.time_since_epoch()));
    for (const Body& body : datagram.bodies) follow(body, t_s, now);
  } catch (const Refused& refused) {
    ++report_.refused[static_cast<std::size_t>(refused.reason)];
    report_.words = refused.words;
    return;
  }
  ++report_.datagrams;
  report_.heard_utime = now;
  // After the clock was set back, nothing was seen later than now.
  for (auto& [name, track] : tracks_) track.seen = std::min(track.seen, now);
  std::erase_if(tracks_, [now](const auto& entry) { return now - entry.second.seen > kGone; });
  publish_state(now, outbox);
  const Duration period = to_duration(1.0 / config_.obstacle_rate_hz);
  if (!rules_.empty() && now >= obstacles_.due(now, period)) publish_obstacles(now, outbox);
}

MocapNode::Datagram MocapNode::read(std::span<const std::uint8_t> bytes) {
  const json object = json::parse(bytes.begin(), bytes.end(), nullptr, false);
  if (object.is_discarded() || !object.is_object()) refuse(MocapRefusal::kJson, "the datagram is not one JSON object");
  Datagram datagram;
  const json& t = field(object, "t", "the datagram");
  if (!t.is_null() && !t.is_number()) refuse(MocapRefusal::kFields, "t: must be a number of seconds or null");
  if (t.is_number()) {
    datagram.t_s = t.get<double>();
    if (!(std::abs(*datagram.t_s) <= kMaxTime_s)) refuse(MocapRefusal::kValue, "t: out of range");
  }
  const json& bodies = field(object, "bodies", "the datagram");
  if (!bodies.is_array()) refuse(MocapRefusal::kFields, "bodies: must be an array");
  if (bodies.size() > kMaxBodies) refuse(MocapRefusal::kValue, "bodies: more than " + std::to_string(kMaxBodies));
  std::set<std::string> names;
  for (const json& entry : bodies) {
    const std::string of = "bodies[" + std::to_string(datagram.bodies.size()) + "]";
    const json& name = field(entry, "name", of);
    if (!name.is_string()) refuse(MocapRefusal::kFields, of + ".name: must be text");
    Body body;
    body.name = name.get<std::string>();
    if (body.name.empty() || body.name.size() > kMaxName)
      refuse(MocapRefusal::kValue, of + ".name: must have 1 to " + std::to_string(kMaxName) + " bytes");
    if (!names.insert(body.name).second) refuse(MocapRefusal::kTwice, of + ".name: is there twice");
    body.position = numbers<3>(field(entry, "position", of), kFarthest_m, of + ".position");
    const Eigen::Vector4d q = numbers<4>(field(entry, "quaternion", of), 1.1, of + ".quaternion");
    if (std::abs(q.norm() - 1.0) > 0.01) refuse(MocapRefusal::kValue, of + ".quaternion: must have length 1");
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    body.yaw_rad = std::atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z);
    datagram.bodies.push_back(std::move(body));
  }
  return datagram;
}

// Of the motion capture: it must go on; when it begins anew, old samples do not go with new ones.
void MocapNode::follow_clock(const Datagram& datagram) {
  const bool anew = datagram.t_s.has_value() != newest_t_s_.has_value() ||
                    (datagram.t_s && *datagram.t_s < *newest_t_s_ - kRestart_s);
  if (!anew && datagram.t_s && *datagram.t_s <= *newest_t_s_)
    refuse(MocapRefusal::kOld, "t: not later than in the datagram before");
  if (anew) {
    for (auto& [name, track] : tracks_) track.samples.clear();
  }
  newest_t_s_ = datagram.t_s;
}

void MocapNode::follow(const Body& body, double t_s, Utime now) {
  const ObstacleRule* rule = nullptr;
  if (body.name != config_.body) {
    const auto found = std::ranges::find_if(rules_, [&](const ObstacleRule& r) { return r.matches(body.name); });
    if (found == rules_.end() || (tracks_.size() >= kMaxBodies && !tracks_.contains(body.name))) {
      ++report_.passed_over;
      return;
    }
    rule = &*found;
  }
  Track& track = tracks_[body.name];
  if (!track.samples.empty()) {
    const Sample& before = track.samples.back();
    if ((body.position - before.position).norm() > kJump_m + kJump_mps * (t_s - before.t_s)) {
      ++report_.jumps;
      track.samples.clear();
    }
  }
  while (!track.samples.empty() && (track.samples.front().t_s < t_s - kWindow_s || track.samples.back().t_s >= t_s))
    track.samples.pop_front();
  track.samples.push_back({t_s, body.position});
  track.position = body.position;
  track.yaw_rad = body.yaw_rad;
  track.seen = now;
  track.rule = rule;
}

// The slope of the straight line through the samples, by least squares; zero where they are too few.
Eigen::Vector3d MocapNode::velocity_of(const Track& track) {
  if (track.samples.empty()) return Eigen::Vector3d::Zero();
  const auto n = static_cast<double>(track.samples.size());
  if (track.samples.back().t_s - track.samples.front().t_s < kLeastSpan_s) return Eigen::Vector3d::Zero();
  double mean_t = 0.0;
  for (const Sample& sample : track.samples) mean_t += (sample.t_s - track.samples.front().t_s) / n;
  mean_t += track.samples.front().t_s;
  Eigen::Vector3d product = Eigen::Vector3d::Zero();
  double square = 0.0;
  for (const Sample& sample : track.samples) {
    const double t = sample.t_s - mean_t;
    product += t * (sample.position - track.samples.front().position);
    square += t * t;
  }
  return (product / square).cwiseMax(-kMaxVelocity_mps).cwiseMin(kMaxVelocity_mps);
}

void MocapNode::publish_state(Utime now, Outbox& outbox) {
  const auto own = tracks_.find(config_.body);
  if (own == tracks_.end() || own->second.rule != nullptr || own->second.seen != now) return;
  const Track& track = own->second;
  sogm_swarm::robot_state_t state{};
  state.header = state_headers_.next(now - to_duration(config_.delay_s));
  Eigen::Map<Eigen::Vector3d>(state.position) = track.position;
  Eigen::Map<Eigen::Vector3d>(state.velocity) = velocity_of(track);
  state.yaw = track.yaw_rad;
  outbox.publish(BusId::kOnboard, channel::kRobotState, state);
  ++report_.states;
}

void MocapNode::publish_obstacles(Utime now, Outbox& outbox) {
  sogm_swarm::obstacles_t message{};
  message.header = obstacle_headers_.next(now - to_duration(config_.delay_s));
  for (const auto& [name, track] : tracks_) {
    if (track.rule == nullptr) continue;
    obstacle_t& obstacle = message.obstacles.emplace_back();
    obstacle.id = id_of(name);
    obstacle.shape = track.rule->shape;
    const Eigen::Vector3d& offset = track.rule->offset;
    const double c = std::cos(track.yaw_rad), s = std::sin(track.yaw_rad);
    const Eigen::Vector3d turned(c * offset.x() - s * offset.y(), s * offset.x() + c * offset.y(), offset.z());
    Eigen::Map<Eigen::Vector3d>(obstacle.position) = track.position + turned;
    Eigen::Map<Eigen::Vector3d>(obstacle.velocity) = velocity_of(track);
    obstacle.yaw = track.yaw_rad;
    Eigen::Map<Eigen::Vector3d>(obstacle.size) = track.rule->size;
    obstacle.age_s = to_seconds(now - track.seen);
  }
  message.num_obstacles = static_cast<std::int32_t>(message.obstacles.size());
  outbox.publish(BusId::kOnboard, channel::kObstacles, message);
  report_.obstacles = message.num_obstacles;
  ++report_.obstacle_messages;
  obstacles_.done(now);
}

}  // namespace swarm
