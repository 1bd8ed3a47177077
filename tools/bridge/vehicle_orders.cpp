#include "tools/bridge/vehicle_orders.h"

#include "sogm_swarm/vehicle_status_t.hpp"

namespace swarm {
namespace {

using mavlink::CommandLong;
using mavlink::Heartbeat;
using sogm_swarm::flight_status_t;
using sogm_swarm::vehicle_status_t;

constexpr Duration kAgain = 500ms;
constexpr std::uint32_t kPx4Offboard = 6, kArdupilotGuided = 4;

CommandLong command(std::uint16_t number, float first, float second = 0, float seventh = 0) {
  CommandLong command;
  command.command = number;
  command.parameters = {first, second, 0, 0, 0, 0, seventh};
  return command;
}

}  // namespace

const char* Controller::led_mode() const {
  const std::uint32_t mode = heartbeat.custom_mode;
  if (heartbeat.autopilot == Heartbeat::kPx4 && (mode >> 16 & 0xFF) == kPx4Offboard) return "offboard mode";
  if (heartbeat.autopilot == Heartbeat::kArdupilot && mode == kArdupilotGuided) return "guided mode";
  return nullptr;
}

bool Controller::obeys() const {
  const bool is_known = heartbeat.autopilot == Heartbeat::kPx4 || heartbeat.autopilot == Heartbeat::kArdupilot;
  return armed() && (!is_known || led_mode() != nullptr);
}

std::int16_t Controller::place() const {
  switch (landed_state) {
    case mavlink::ExtendedSysState::kOnGround:
      return vehicle_status_t::kOnGround;
    case mavlink::ExtendedSysState::kInAir:
    case mavlink::ExtendedSysState::kTakeOff:
    case mavlink::ExtendedSysState::kLanding:
      return vehicle_status_t::kInAir;
    default:
      return vehicle_status_t::kUnknown;
  }
}

std::optional<CommandLong> VehicleOrders::next(Utime now, const Controller& controller, const flight_status_t& flight,
                                               bool is_followable) {
  const bool stands = flight.state == flight_status_t::kOnGround;
  was_up_ = !stands || (was_up_ && controller.armed());
  if (now < told_.due(now, kAgain)) return std::nullopt;
  std::optional<CommandLong> order;
  const bool is_ardupilot = controller.heartbeat.autopilot == Heartbeat::kArdupilot;
  const bool is_known = is_ardupilot || controller.heartbeat.autopilot == Heartbeat::kPx4;
  if (flight.state == flight_status_t::kTakeOff && is_followable) {
    if (is_known && controller.led_mode() == nullptr)
      order = command(CommandLong::kSetMode, 1, static_cast<float>(is_ardupilot ? kArdupilotGuided : kPx4Offboard));
    else if (!controller.armed())
      order = command(CommandLong::kArm, 1);
    else if (rises_by_itself(controller, flight))
      order = command(CommandLong::kTakeOff, 0, 0, static_cast<float>(flight.climb));
  }
  // Only what landed, or did not take off: who is armed on the ground by his pilot stays so.
  const bool is_over = stands && was_up_ && flight.cause != flight_status_t::kVehicle;
  if (is_over && controller.armed() && controller.place() != vehicle_status_t::kInAir)
    order = command(CommandLong::kArm, 0);
  if (order) told_.done(now);
  return order;
}

// In guided mode ArduPilot leaves the ground by command only.
bool VehicleOrders::rises_by_itself(const Controller& controller, const flight_status_t& flight) {
  return controller.heartbeat.autopilot == Heartbeat::kArdupilot && flight.state == flight_status_t::kTakeOff &&
         flight.led_to == flight_status_t::kNowhere && controller.place() != vehicle_status_t::kInAir;
}

}  // namespace swarm
