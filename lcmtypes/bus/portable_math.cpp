#include "lcmtypes/bus/portable_math.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace swarm {

SinCos sin_cos(double angle_rad) {
  // Less the quarter turns, pi / 2 in two parts: the products with the first, of 33 bits, are exact.
  constexpr double kFirst = 0x1.921fb544p+0, kSecond = 0x1.0b4611a626331p-34;
  const double turns = std::round(angle_rad * (2.0 / std::numbers::pi));
  const double rest = (angle_rad - turns * kFirst) - turns * kSecond, squared = rest * rest;
  double sin = 1.0, cos = 1.0;  // the series from their far ends
  for (int k = 16; k > 0; k -= 2) {
    cos = 1.0 - squared * (1.0 / ((k - 1) * k)) * cos;
    sin = 1.0 - squared * (1.0 / (k * (k + 1))) * sin;
  }
  sin *= rest;
  switch (static_cast<long>(turns) & 3) {
    case 0:
      return {sin, cos};
    case 1:
      return {cos, -sin};
    case 2:
      return {-sin, -cos};
    default:
      return {-cos, sin};
  }
}

double direction(double x, double y) {
  const double large = std::max(std::abs(x), std::abs(y)), small = std::min(std::abs(x), std::abs(y));
  const double tangent = large > 0.0 ? small / large : 0.0;
  // A guess good to 4e-3, and the angle that it lacks by that angle's tangent.
  double angle = tangent * (0.25 * std::numbers::pi + 0.273 * (1.0 - tangent));
  const SinCos guess = sin_cos(angle);
  const double lack = (tangent * guess.cos - guess.sin) / (guess.cos + tangent * guess.sin), squared = lack * lack;
  angle += lack * (1.0 - squared * (1.0 / 3.0 - squared * (1.0 / 5.0)));
  if (std::abs(y) > std::abs(x)) angle = 0.5 * std::numbers::pi - angle;
  if (std::signbit(x)) angle = std::numbers::pi - angle;
  return std::copysign(angle, y);
}

double logarithm(double value) {
  // value = mantissa * 2^exponent, mantissa in [sqrt(1 / 2), sqrt(2))
  const auto bits = std::bit_cast<std::int64_t>(value);
  const std::int64_t exponent = (bits - std::bit_cast<std::int64_t>(0.5 * std::numbers::sqrt2)) >> 52;
  const double mantissa = std::bit_cast<double>(bits - (exponent << 52));
  // log m = 2 artanh s = 2 (s + s^3 / 3 + s^5 / 5 + ...), even and odd terms apart: they do not wait for each other.
  const double s = (mantissa - 1.0) / (mantissa + 1.0), squared = s * s, fourth = squared * squared;
  double even = 0.0, odd = 0.0;
  for (int k = 21; k > 0; k -= 4) {
    even = even * fourth + 1.0 / k;
    if (k > 1) odd = odd * fourth + 1.0 / (k - 2);
  }
  return static_cast<double>(exponent) * std::numbers::ln2 + 2.0 * s * (even + squared * odd);
}

}  // namespace swarm
