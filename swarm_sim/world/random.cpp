#include "swarm_sim/world/random.h"

#include <cmath>
#include <numbers>

#include "lcmtypes/bus/portable_math.h"

namespace swarm {

// FNV-1a.
std::uint64_t seed_of(const std::string& name) {
  std::uint64_t seed = 0xcbf29ce484222325ULL;
  for (const char c : name) seed = (seed ^ static_cast<unsigned char>(c)) * 0x100000001b3ULL;
  return seed;
}

double Random::normal() {
  const double radius = std::sqrt(-2.0 * logarithm(1.0 - uniform()));
  return radius * sin_cos(2.0 * std::numbers::pi * uniform()).cos;
}

Eigen::Vector3d Random::normal3() {
  Eigen::Vector3d values;
  for (double& value : values) value = normal();
  return values;
}

}  // namespace swarm
