// Fits bridge and planner to a vehicle, from logs of its flights.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>
#include <optional>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_log.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/text.h"
#include "tools/logs/identification.h"
#include "tools/logs/log_messages.h"

namespace swarm {
namespace {

constexpr Duration kGap = 60ms;      // without setpoints: another flight
constexpr double kJump_m = 0.25;     // from one setpoint to the next: the robot went on from somewhere else
constexpr double kPrediction = 1.7;  // a model says at best 0.6 of what is measured later

// The flights of one robot, as its setpoints and states are read.
class Reader {
 public:
  void add(const sogm_swarm::setpoint_t& m) {
    const Utime utime = to_utime(m.header.utime);
    const MotionState told{Eigen::Vector3d(m.position), Eigen::Vector3d(m.velocity), Eigen::Vector3d(m.acceleration),
                           Eigen::Vector3d(m.jerk)};
    if (newest_ && utime <= *newest_) return;  // it is in two logs, or late
    const bool goes_on = newest_ && utime - *newest_ <= kGap &&
                         (told.position - flights_.back().setpoints.back().told.position).norm() <= kJump_m;
    if (!goes_on) flights_.emplace_back();
    flights_.back().setpoints.push_back({seconds(utime), told});
    newest_ = utime;
  }
  void add(const sogm_swarm::robot_state_t& m) {
    const Utime utime = to_utime(m.header.utime);
    if (newest_state_ && utime <= *newest_state_) return;
    newest_state_ = utime;
    states_.push_back({seconds(utime), Eigen::Vector3d(m.position), Eigen::Vector3d(m.velocity)});
  }
  // Those that are long enough to tell something.
  std::vector<RecordedFlight> flights() {
    std::vector<RecordedFlight> all;
    for (RecordedFlight& flight : flights_) {
      for (const RecordedFlight::Seen& state : states_) {
        if (state.time_s >= flight.setpoints.front().time_s && state.time_s <= flight.setpoints.back().time_s)
          flight.states.push_back(state);
      }
      if (flight.duration_s() > kWarmUp_s) all.push_back(std::move(flight));
    }
    return all;
  }

 private:
  double seconds(Utime utime) {
    if (!first_) first_ = utime;
    return to_seconds(utime - *first_);
  }

  std::optional<Utime> first_, newest_, newest_state_;
  std::vector<RecordedFlight> flights_;
  std::vector<RecordedFlight::Seen> states_;
};

std::vector<RecordedFlight> read_flights(const std::vector<std::string>& paths) {
  std::vector<RecordedFlight> all;
  for (const std::string& path : paths) {
    LcmLog log(path);
    std::map<int, Reader> robots;
    for (LogEvent event; log.next(&event);) {
      visit_message(event.channel, event.bytes, [&]<class T>(const T& message) {
        if constexpr (std::is_same_v<T, sogm_swarm::setpoint_t> || std::is_same_v<T, sogm_swarm::robot_state_t>)
          robots[message.header.robot_id].add(message);
      });
    }
    std::size_t before = all.size();
    for (auto& [id, reader] : robots) {
      for (RecordedFlight& flight : reader.flights()) all.push_back(std::move(flight));
    }
    if (all.size() == before)
      throw std::runtime_error(path + ": holds no flight of more than " + fixed(kWarmUp_s, 1) +
                               " s with both SETPOINT and ROBOT_STATE (the onboard bus of a robot)");
  }
  return all;
}

std::string row(const VehicleParameter& parameter, const IdentifiedVehicle& found) {
  const double value = found.value.*parameter.member, sigma = found.sigma.*parameter.member;
  char line[160];
  std::snprintf(line, sizeof line, "  %-14s %7.3f +- %5.3f %-6s%s\n", parameter.name, value, 2 * sigma, parameter.unit,
                found.well_known(parameter) ? "" : "  these flights do not tell");
  return line;
}

// Measured and model, with what was told, for a picture.
void write_csv(const std::string& path, const std::vector<RecordedFlight>& flights, const IdentifiedVehicle& found,
               const VehicleFit& told_with) {
  std::ofstream file(path);
  file
      << "flight,time_s,told_x,told_y,told_z,seen_x,seen_y,seen_z,model_x,model_y,model_z,fitted_x,fitted_y,fitted_z\n";
  for (std::size_t k = 0; k < flights.size(); ++k) {
    const RecordedFlight& flight = flights[k];
    const auto model = simulated(flight, found.value, told_with), fitted = simulated(flight, found.value, found.fit);
    const std::size_t first = flight.states.size() - model.size();
    std::size_t setpoint = 0;
    for (std::size_t i = 0; i < model.size(); ++i) {
      const RecordedFlight::Seen& seen = flight.states[first + i];
      while (setpoint + 1 < flight.setpoints.size() && flight.setpoints[setpoint + 1].time_s <= seen.time_s) ++setpoint;
      file << k << ',' << fixed(seen.time_s, 4);
      for (const Eigen::Vector3d& place :
           {flight.setpoints[setpoint].told.position, seen.position, model[i].position, fitted[i].position}) {
        for (int axis = 0; axis < 3; ++axis) file << ',' << fixed(place[axis], 5);
      }
      file << '\n';
    }
  }
  file.flush();
  if (!file) fail_to_write(path);
}

// What the attitude can follow: an axis that accelerates as fast as in these flights has as much more to turn the
// thrust with as is left until the robot is tilted by 45 degrees, and jerk needs the attitude's lag times itself of
// that.
double flyable_jerk(const std::vector<RecordedFlight>& flights, double attitude_lag_s) {
  constexpr double kGravity_mps2 = 9.81, kLeast_mps3 = 20.0, kMost_mps3 = 500.0;
  double most_mps2 = 0.0;
  for (const RecordedFlight& flight : flights) {
    for (const RecordedFlight::Setpoint& setpoint : flight.setpoints)
      most_mps2 = std::max(most_mps2, setpoint.told.acceleration.cwiseAbs().maxCoeff());
  }
  return std::clamp((kGravity_mps2 - most_mps2) / std::max(attitude_lag_s, 1e-3), kLeast_mps3, kMost_mps3);
}

int identify_command(int argc, const char* const* argv) {
  std::vector<std::string> paths;
  VehicleFit told_with;
  std::string csv;
  OptionSet options(
      "identify",
      "Fits mavlink_bridge and the planner to a vehicle, from LCM logs of its flights in calm air (SETPOINT "
      "and ROBOT_STATE):\ndelay, lags, gains and drag of vehicle and controller with their uncertainty, "
      "the lines of configuration that\nfollow, and how far the robot was, and will be, from its "
      "setpoints. Refuses flights that do not tell what\nit needs: tools/deploy/README.md has the "
      "flight to fly.");
  options.add("lead", &told_with.lead_s, 0, 0.5, "s", "of the bridge in these flights");
  options.add("lag", &told_with.lag_s, 0, 1, "s", "of the bridge in these flights");
  options.add("drag", &told_with.drag_per_s, 0, 10, "1/s", "of the bridge in these flights");
  options.add("csv", &csv, "file for what was told, measured, and what the model says; empty: none");
  options.add_positional("LOG", &paths, "LCM log of a robot's onboard bus; all are of vehicles of one kind");
  if (options.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return 0;
  if (paths.empty()) throw OptionError("a log must be given (see --help)");
  const std::vector<RecordedFlight> flights = read_flights(paths);
  double seconds = 0.0;
  for (const RecordedFlight& flight : flights) seconds += flight.duration_s();
  std::cout << flights.size() << " flights, " << fixed(seconds, 0) << " s in all" << std::endl;
  const IdentifiedVehicle found = identify(flights, told_with);
  std::cout << "\nvehicle and controller (within two standard deviations)\n";
  for (const VehicleParameter& parameter : vehicle_parameters()) std::cout << row(parameter, found);
  std::cout << "  not explained by them: " << fixed(100 * found.position_noise_m, 1) << " cm, "
            << fixed(found.velocity_noise_mps, 2) << " m/s an axis\n\n"
            << "distance from the setpoints, 99 of 100 within\n  as measured            "
            << fixed(found.measured_p99_m, 3) << " m\n  as the model says      " << fixed(found.model_p99_m, 3)
            << " m\n  with the lines below   " << fixed(found.fitted_p99_m, 3) << " m, of the model\n";
  if (!csv.empty()) write_csv(csv, flights, found, told_with);
  std::string unknown;
  for (const VehicleParameter& parameter : vehicle_parameters()) {
    const bool is_needed = parameter.member == &VehicleParameters::delay_s ||
                           parameter.member == &VehicleParameters::attitude_lag_s ||
                           parameter.member == &VehicleParameters::drag_per_s;
    if (is_needed && !found.well_known(parameter))
      unknown += (unknown.empty() ? "" : ", ") + std::string(parameter.name);
  }
  if (!unknown.empty()) {
    throw std::runtime_error("these flights do not tell " + unknown +
                             ": fly faster, with changes of direction, in calm air (tools/deploy/README.md)");
  }
  const double jerk_mps3 = flyable_jerk(flights, found.value.attitude_lag_s);
  const double off_m = kPrediction * (found.fitted_p99_m + 2.0 * found.position_noise_m);
  std::cout << "\nmavlink_bridge.cfg\n  lead = " << fixed(found.fit.lead_s, 3)
            << "\n  lag = " << fixed(found.fit.lag_s, 3) << "\n  drag = " << fixed(found.fit.drag_per_s, 2)
            << "\nplanner_daemon.cfg\n  clearance = " << fixed(std::max(0.05, std::ceil(100 * (off_m - 0.05)) / 100), 2)
            << "\nbroadcast_daemon.cfg\n  error-bound = " << fixed(std::max(0.3, std::ceil(100 * 2 * off_m) / 100), 2)
            << "\nrobot.env\n  J_MAX=" << fixed(jerk_mps3, 0) << std::endl;
  return 0;
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) try {
  return swarm::identify_command(argc, argv);
} catch (const std::exception& error) {
  std::cerr << "identify: " << error.what() << std::endl;
  return 2;
}
