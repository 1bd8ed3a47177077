// Motion capture to the onboard bus: where the robot is, and what moves around it. Input are datagrams with one JSON
// object each, positions in W [m], quaternions body to W:
//   {"t": 12.34, "bodies": [{"name": "robot0", "position": [x, y, z], "quaternion": [w, x, y, z]}, ...]}
// "t" is the time of measurement by the motion capture's own clock [s], or null; other keys mean nothing here.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/recurring.h"

namespace swarm {

// What a body of that name is as an obstacle.
struct ObstacleRule {
  std::string name;  // of the body; with '*' at its end all that begin so
  std::int16_t shape = 0;
  Eigen::Vector3d size = Eigen::Vector3d::Zero();    // as in obstacle_t [m]
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();  // from the body's origin to the shape's centre, turned by its yaw

  bool matches(const std::string& body) const;
};

// From "NAME:SHAPE:SIZES[:OFFSET];...": column:DIAMETER,HEIGHT, ring:RADIUS,TUBE, box:LENGTH,WIDTH,HEIGHT or
// sphere:DIAMETER, the offset as X,Y,Z. Throws OptionError with the part and the rule.
std::vector<ObstacleRule> parse_obstacle_rules(const std::string& text);

struct MocapConfig {
  int robot_id = 0;
  std::string body;              // the robot's own; empty: there is none, and no ROBOT_STATE
  std::string obstacles;         // rules; bodies without one are passed over
  double delay_s = 0.0;          // from a measurement to its arrival here
  double obstacle_rate_hz = 30;  // of OBSTACLES, at most
};

void declare(OptionSet& options, MocapConfig& config);

// Why a datagram was refused, all of it.
enum class MocapRefusal : std::uint8_t {
  kJson,    // not one JSON object
  kFields,  // something is missing or of the wrong kind
  kValue,   // out of range
  kTwice,   // two bodies of one name
  kOld,     // not newer than the one before
};
inline constexpr int kNumMocapRefusals = 5;
const char* to_string(MocapRefusal reason);

struct MocapReport {
  std::optional<Utime> heard_utime;  // the newest good datagram
  std::int64_t datagrams = 0;        // good ones
  std::array<std::int64_t, kNumMocapRefusals> refused{};
  std::string words;  // what was wrong with the newest refused one
  std::int64_t states = 0, obstacle_messages = 0;
  std::int64_t passed_over = 0;  // bodies that are neither the robot nor by any rule an obstacle
  std::int64_t jumps = 0;        // bodies that were suddenly somewhere else
  int obstacles = 0;             // in the newest message
};

class MocapNode : public Node {
 public:
  // `boot` as in HeaderSource. Throws OptionError on bad rules.
  MocapNode(const MocapConfig& config, std::int32_t boot);

  std::vector<Subscription> subscriptions() const override { return {}; }
  void on_message(Utime, BusId, std::string_view, std::span<const std::uint8_t>, Outbox&) override {}
  Utime step(Utime now, Outbox&) override { return now + 1s; }

  // Publishes what a datagram tells. An obstacle that 0.5 s of good datagrams do not show is gone; when none come at
  // all, nothing is said: how long old obstacles count is for the map daemon to decide.
  void on_datagram(Utime now, std::span<const std::uint8_t> bytes, Outbox& outbox);

  const MocapReport& report() const { return report_; }

 private:
  struct Body {
    std::string name;
    Eigen::Vector3d position;
    double yaw_rad = 0.0;
  };
  struct Datagram {
    std::optional<double> t_s;
    std::vector<Body> bodies;
  };
  struct Sample {
    double t_s;
    Eigen::Vector3d position;
  };
  struct Track {
    Eigen::Vector3d position = Eigen::Vector3d::Zero();  // the newest
    double yaw_rad = 0.0;
    std::deque<Sample> samples;  // of the last 0.2 s, by the clock of the datagrams; none after a restart of that
    Utime seen{};
    const ObstacleRule* rule = nullptr;  // none: the robot itself
  };

  // Throws what MocapRefusal tells, with words.
  static Datagram read(std::span<const std::uint8_t> bytes);
  void follow_clock(const Datagram& datagram);
  void follow(const Body& body, double t_s, Utime now);
  static Eigen::Vector3d velocity_of(const Track& track);
  void publish_state(Utime now, Outbox& outbox);
  void publish_obstacles(Utime now, Outbox& outbox);

  MocapConfig config_;
  std::vector<ObstacleRule> rules_;
  HeaderSource state_headers_, obstacle_headers_;
  MocapReport report_;
  std::optional<double> newest_t_s_;  // none: the datagrams have no time
  std::map<std::string, Track> tracks_;
  Recurring obstacles_;  // published
};

}  // namespace swarm
