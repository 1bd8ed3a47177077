// Time as types: a point in time and a duration do not mix, and neither is a mere number. Both count whole
// microseconds, as the wire does; what physics and options count in seconds are doubles whose names end in _s.
#pragma once

#include <chrono>
#include <cmath>
#include <cstdint>

namespace swarm {

using namespace std::chrono_literals;  // 20ms, 1s

using Duration = std::chrono::microseconds;

// Microseconds since the epoch, whoever's clock they are read from: node_clock.h says which there are.
struct UtimeClock {};
using Utime = std::chrono::time_point<UtimeClock, Duration>;
inline constexpr Utime kNever = Utime::max();  // nothing may be added to it

// From and to what messages, logs and files carry [us since epoch].
constexpr Utime to_utime(std::int64_t us) {
  return Utime(Duration(us));
}
constexpr std::int64_t to_us(Utime utime) {
  return utime.time_since_epoch().count();
}

constexpr double to_seconds(Duration duration) {
  return 1e-6 * static_cast<double>(duration.count());
}
constexpr double to_ms(std::chrono::nanoseconds duration) {
  return 1e-6 * static_cast<double>(duration.count());
}
// The nearest whole microsecond; `seconds` within +-9e12.
inline Duration to_duration(double seconds) {
  return Duration(std::llround(seconds * 1e6));
}

}  // namespace swarm
