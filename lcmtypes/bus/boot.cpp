#include "lcmtypes/bus/boot.h"

#include <algorithm>
#include <chrono>
#include <limits>
#include <thread>

#include "lcmtypes/bus/node_clock.h"

namespace swarm {

std::int32_t new_boot() {
  constexpr std::int64_t kTick_us = 50'000;
  const std::int64_t boot = steady_us() / kTick_us + 1;
  while (steady_us() < boot * kTick_us)
    std::this_thread::sleep_for(std::chrono::microseconds(boot * kTick_us - steady_us()));
  return static_cast<std::int32_t>(std::min<std::int64_t>(boot, std::numeric_limits<std::int32_t>::max()));
}

}  // namespace swarm
