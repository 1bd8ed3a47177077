// What a vehicle and its flight controller make of setpoints: found from what it was told and where it went.
//
// The model is the standard reduction of a multicopter under a cascaded controller: what is told takes a while to act;
// a position controller (feed-forward, gains on position, velocity and the integral of the position) wants a pull; the
// thrust's direction follows it with the lag of the attitude loop, its amount with that of the motors; air holds it
// back. The whole flight is simulated from what was told alone (output error), so noise of the states does not bias the
// fit.
#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <string>
#include <vector>

#include "planner_daemon/trajectory/bezier.h"
#include "planner_daemon/trajectory/vehicle_fit.h"

namespace swarm {

struct VehicleParameters {
  double delay_s = 0.03;         // from what is told until it acts
  double attitude_lag_s = 0.08;  // of the thrust's direction
  double thrust_lag_s = 0.05;    // of its amount
  double position_per_s2 = 5.0;  // gains
  double velocity_per_s = 4.0;
  double integral_per_s3 = 1.0;
  double drag_per_s = 0.2;
};
inline constexpr int kNumVehicleParameters = 7;
// Name, unit and member of each.
struct VehicleParameter {
  const char *name, *unit;
  double VehicleParameters::*member;
  double low, high;  // what is looked for
  double scale;      // of what is well known to it: see IdentifiedVehicle::well_known
};
const std::array<VehicleParameter, kNumVehicleParameters>& vehicle_parameters();

// One robot's flight without gaps. Times in seconds, of one clock, ascending.
struct RecordedFlight {
  struct Setpoint {
    double time_s;
    MotionState told;  // position, velocity, acceleration, jerk
  };
  struct Seen {
    double time_s;
    Eigen::Vector3d position, velocity;
  };
  std::vector<Setpoint> setpoints;
  std::vector<Seen> states;

  double duration_s() const { return states.empty() ? 0.0 : states.back().time_s - states.front().time_s; }
};

struct IdentifiedVehicle {
  VehicleParameters value;
  VehicleParameters sigma;          // standard deviations
  double position_noise_m = 0.0;    // of an axis: what the model does not explain of where it was,
  double velocity_noise_mps = 0.0;  // and of how fast
  // Errors of tracking, 3-D, 99th percentile: as measured; as the model says for what was told, and for `fit`.
  double measured_p99_m = 0.0, model_p99_m = 0.0, fitted_p99_m = 0.0;
  VehicleFit fit;  // what the vehicle is to be told

  // Whether the flights say enough of a parameter: its deviation is within a tenth of it, or of what is usual.
  bool well_known(const VehicleParameter& parameter) const;
};

// `told_with`: what the setpoints were given on their way in these flights. Throws std::runtime_error where there is
// too little to fit.
IdentifiedVehicle identify(std::span<const RecordedFlight> flights, const VehicleFit& told_with);

// Where the model says that the vehicle was at the times of the flight's states, W [m]. Empty within the first
// kWarmUp_s: what was before the flight is not known.
inline constexpr double kWarmUp_s = 1.5;
std::vector<RecordedFlight::Seen> simulated(const RecordedFlight& flight, const VehicleParameters& vehicle,
                                            const VehicleFit& told_with);

}  // namespace swarm
