#include "lcmtypes/bus/boot.h"

#include <algorithm>
#include <limits>
#include <thread>

#include "lcmtypes/bus/node_clock.h"

namespace swarm {

std::int32_t new_boot() {
  constexpr Duration kTick = 50ms;
  const std::int64_t boot = uptime() / kTick + 1;
  while (uptime() < boot * kTick) std::this_thread::sleep_for(boot * kTick - uptime());
  return static_cast<std::int32_t>(std::min<std::int64_t>(boot, std::numeric_limits<std::int32_t>::max()));
}

}  // namespace swarm
