// What a flight controller is told beside where to fly: to arm, to follow, to rise, to disarm.
#pragma once

#include <cstdint>
#include <optional>

#include "lcmtypes/bus/recurring.h"
#include "sogm_swarm/flight_status_t.hpp"
#include "tools/bridge/mavlink.h"

namespace swarm {

// The flight controller as it was heard last.
struct Controller {
  mavlink::Heartbeat heartbeat;
  std::uint8_t landed_state = 0;  // ExtendedSysState's; 0: not known

  bool armed() const { return (heartbeat.base_mode & mavlink::Heartbeat::kArmed) != 0; }
  // Its flight mode by name if it is one in which targets are obeyed, else null; and whether they are, as far as is
  // known.
  const char* led_mode() const;
  bool obeys() const;
  // One of vehicle_status_t's.
  std::int16_t place() const;
};

// Follows what the broadcast daemon says of the flight.
class VehicleOrders {
 public:
  // What the controller is to be told now, if anything: again and again until it is so. `is_followable`: targets go
  // out, and near the vehicle.
  std::optional<mavlink::CommandLong> next(Utime now, const Controller& controller,
                                           const sogm_swarm::flight_status_t& flight, bool is_followable);
  // Whether the controller rises by a means of its own: then targets would end that.
  static bool rises_by_itself(const Controller& controller, const sogm_swarm::flight_status_t& flight);

 private:
  Recurring told_;
  bool was_up_ = false;  // and has not been disarmed since
};

}  // namespace swarm
