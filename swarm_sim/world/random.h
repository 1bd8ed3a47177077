// Random numbers that are the same on every machine: the standard fixes its engines' numbers, but not those of its
// distributions.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <random>
#include <string>

namespace swarm {

// Other names, other numbers.
std::uint64_t seed_of(const std::string& name);

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}

  double uniform() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }  // in [0, 1)
  double normal();                                                             // of mean 0 and variance 1 (Box, Muller)
  Eigen::Vector3d normal3();                                                   // each axis for itself

 private:
  std::mt19937_64 engine_;
};

}  // namespace swarm
