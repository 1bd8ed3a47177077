// What keeps a robot from being where it is told to be, and from seeing what there is. By default nothing does.
#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <string>
#include <vector>

namespace swarm {

// The body and its flight controller: see vehicle_model.h. Standard deviations are of one axis.
struct VehicleOptions {
  // perfect: is where its setpoints say; noisy: wanders about there; quadrotor: a body with lag and drag, in the wind.
  std::string kind = "perfect";
  double tracking_sigma_m = 0.05;  // of noisy
  // Of quadrotor: steady wind, with gusts of a fifth of it; how firmly the controller holds on to the setpoint.
  double wind_mps = 0.0;
  std::string gains = "firm";  // or soft
  // Of quadrotor: at some moment in every ten seconds something runs into it and makes it so much faster, to some side.
  double shove_mps = 0.0;
  // Of quadrotor: what its setpoints are given on their way (vehicle_fit.h); as tools/identify finds them for it.
  double lead_ms = 12.0, lag_ms = 35.0, drag_per_s = 0.28;
  // By so much the robot errs about where it is: half of it wanders within half a second, half within twenty.
  double own_noise_m = 0.0;
  bool operator==(const VehicleOptions&) const = default;
};

// How obstacles are detected: see sensor.h. Standard deviations are of one axis.
struct SensorOptions {
  // perfect: obstacles are reported, with the errors below; lidar, depth: scans or images are, and see what they see.
  std::string kind = "perfect";
  double rate_hz = 20.0;
  double position_m = 0.0, velocity_mps = 0.0;      // noise
  double latency_ms = 0.0;                          // from what is seen to the message
  double dropout = 0.0;                             // share of the detections that are missing, each for itself
  double burst = 0.0;                               // share of the time that an obstacle is not seen for half a second
  double false_alarms = 0.0;                        // detections of nothing in a message, on average
  double merge_m = 0.0;                             // columns this near to each other are taken for one
  double pose_noise_m = 0.0, pose_noise_deg = 0.0;  // by so much a lidar or depth camera errs about where it is
  std::string pose_drift;                           // file: robots drift from where they take themselves to be
  std::string mounts;                               // of several of them, see parse_mounts(); empty: one, ahead
  std::string known_map = "static";                 // what robots know before they fly: the static map, or none
  bool operator==(const SensorOptions&) const = default;

  bool is_ranging() const { return kind != "perfect"; }
  // Whatever is there is seen.
  bool complete() const { return dropout == 0.0 && burst == 0.0 && merge_m == 0.0; }
};

// One visitor made of several.
template <class... Functions>
struct Overloaded : Functions... {
  using Functions::operator()...;
};
template <class... Functions>
Overloaded(Functions...) -> Overloaded<Functions...>;  // clang 14 does not find that by itself

// How a sensor sits on its robot: turned to the left, then downwards; at a place in the robot's frame (x ahead, y left,
// z up).
struct Mount {
  double yaw_deg = 0.0, pitch_deg = 0.0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // [m]
};

// YAW[:PITCH[:X:Y:Z]],...: at most eight, in degrees and metres; "": one, ahead. Throws OptionError.
std::vector<Mount> parse_mounts(const std::string& text);
inline void check_mounts(const std::string& text) {
  (void)parse_mounts(text);
}

// Throws OptionError unless it is a file of poses (tools/scans/pose_file.h); "": none.
void check_pose_drift(const std::string& file);

// Every value once, under the name that it has on the command line and in world files: visit(name, value, low, high,
// unit, help) for numbers, visit(name, value, words, help) for one of some words, visit(name, value, check, help) for a
// text; check(text) throws OptionError.
inline constexpr std::array<const char*, 3> kVehicles = {"perfect", "noisy", "quadrotor"};
inline constexpr std::array<const char*, 2> kGains = {"firm", "soft"};
inline constexpr std::array<const char*, 3> kSensors = {"perfect", "depth", "lidar"};
inline constexpr std::array<const char*, 2> kKnownMaps = {"static", "none"};

// "a, b or c".
std::string listed(std::span<const char* const> words);

template <class Options, class Visit>
void for_each_vehicle_option(Options& vehicle, const Visit& visit) {
  visit("vehicle", vehicle.kind, kVehicles, "what flies");
  visit("tracking-sigma-m", vehicle.tracking_sigma_m, 0, 1, "m", "noisy: deviation of an axis about the setpoint");
  visit("wind-mps", vehicle.wind_mps, 0, 30, "m/s", "quadrotor: steady wind, with gusts of a fifth of it");
  visit("gains", vehicle.gains, kGains, "quadrotor: of its flight controller");
  visit("shove-mps", vehicle.shove_mps, 0, 20, "m/s",
        "quadrotor: at some moment in every 10 s something makes it so much faster, to some side");
  visit("lead-ms", vehicle.lead_ms, 0, 500, "ms", "quadrotor: its setpoints are those of so much later");
  visit("lag-ms", vehicle.lag_ms, 0, 1000, "ms", "quadrotor: and accelerate by so much times their jerk more");
  visit("drag", vehicle.drag_per_s, 0, 10, "1/s", "quadrotor: and by so much times their velocity more");
  visit("own-noise-m", vehicle.own_noise_m, 0, 1, "m", "deviation of an axis of where a robot takes itself to be");
}
template <class Options, class Visit>
void for_each_sensor_option(Options& sensor, const Visit& visit) {
  visit("sensor", sensor.kind, kSensors, "what is seen by");
  visit("sensor-rate", sensor.rate_hz, 1, 100, "Hz", "of obstacle detections and depth images; a lidar has 10 Hz");
  visit("sense-position-m", sensor.position_m, 0, 1, "m", "deviation of an axis of a detection's position");
  visit("sense-velocity-mps", sensor.velocity_mps, 0, 10, "m/s", "deviation of an axis of a detection's velocity");
  visit("sense-latency-ms", sensor.latency_ms, 0, 1000, "ms", "from what is seen to the message that says so");
  visit("sense-dropout", sensor.dropout, 0, 1, "", "share of the detections that are missing");
  visit("sense-burst", sensor.burst, 0, 0.9, "", "share of the time that an obstacle is not seen for half a second");
  visit("sense-false", sensor.false_alarms, 0, 10, "", "detections of nothing in a message, on average");
  visit("sense-merge-m", sensor.merge_m, 0, 10, "m", "columns this near to each other are taken for one");
  visit("pose-noise-m", sensor.pose_noise_m, 0, 1, "m", "depth, lidar: deviation of an axis of where the sensor is");
  visit("pose-noise-deg", sensor.pose_noise_deg, 0, 10, "deg", "depth, lidar: and of how it is turned");
  visit("pose-drift", sensor.pose_drift, &check_pose_drift,
        "file with the error of an odometry by time, as poses: robots take themselves and what they see to be so far "
        "off");
  visit(
      "mounts", sensor.mounts, &check_mounts,
      "depth, lidar: YAW[:PITCH[:X:Y:Z]],...: how each of several sensors sits on its robot, in degrees (to the left, "
      "downwards) and metres (ahead, left, up); none: one, ahead");
  visit("known-map", sensor.known_map, kKnownMaps, "what robots know of the world before they fly: its static map");
}

}  // namespace swarm
