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

std::int32_t new_boot_by_wall_clock() {
  const Utime next = Utime(wall_utime().time_since_epoch() / 1s * 1s) + 1s;
  const Duration latest = uptime() + 1s;  // should the clock be set back meanwhile
  while (wall_utime() < next && uptime() < latest)
    std::this_thread::sleep_for(std::min<Duration>(next - wall_utime(), 10ms));
  return static_cast<std::int32_t>(next.time_since_epoch() / 1s);
}

}  // namespace swarm
