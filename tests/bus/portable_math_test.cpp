// Accurate against the C library in long double, and the same bits on every machine.
#include "lcmtypes/bus/portable_math.h"

#include <array>
#include <bit>
#include <numbers>

namespace swarm {
namespace {

constexpr int kTrials = 100000;

double uniform(std::mt19937_64* random, double low, double high) {
  return low + (high - low) * (static_cast<double>((*random)() >> 11) * 0x1p-53);
}

TEST(PortableMathTest, SineAndCosine) {
  std::mt19937_64 random(1);
  for (int trial = 0; trial < kTrials; ++trial) {
    const double angle = uniform(&random, -1, 1) * std::array{1.0, 4.0, 1e6}[trial % 3];
    const auto [sin, cos] = sin_cos(angle);
    ASSERT_LT(std::abs(sin - std::sin(static_cast<long double>(angle))), 3e-16) << angle;
    ASSERT_LT(std::abs(cos - std::cos(static_cast<long double>(angle))), 3e-16) << angle;
  }
}

TEST(PortableMathTest, QuarterTurns) {
  for (int turns = -9; turns <= 9; ++turns) {
    const auto [sin, cos] = sin_cos(0.5 * std::numbers::pi * turns);
    EXPECT_NEAR(sin, (std::array{0, 1, 0, -1}[turns & 3]), 2e-15) << turns;
    EXPECT_NEAR(cos, (std::array{1, 0, -1, 0}[turns & 3]), 2e-15) << turns;
  }
  EXPECT_EQ(sin_cos(0.0).sin, 0.0);
  EXPECT_EQ(sin_cos(0.0).cos, 1.0);
}

TEST(PortableMathTest, Direction) {
  std::mt19937_64 random(2);
  for (int trial = 0; trial < kTrials; ++trial) {
    const double x = uniform(&random, -1, 1), y = uniform(&random, -1, 1) * std::array{1.0, 1e-3, 1e9}[trial % 3];
    ASSERT_LT(std::abs(direction(x, y) - std::atan2(static_cast<long double>(y), static_cast<long double>(x))), 1e-15)
        << x << " " << y;
  }
  for (const double x : {1.0, 0.0, -0.0, -1.0}) {
    for (const double y : {1.0, 0.0, -0.0, -1.0}) {
      EXPECT_DOUBLE_EQ(direction(x, y), std::atan2(y, x)) << x << " " << y;
      EXPECT_EQ(std::signbit(direction(x, y)), std::signbit(y)) << x << " " << y;
    }
  }
}

TEST(PortableMathTest, Logarithm) {
  std::mt19937_64 random(3);
  for (int trial = 0; trial < kTrials; ++trial) {
    const double value =
        trial % 2 == 0 ? uniform(&random, 0.5, 2.0) : std::ldexp(uniform(&random, 1, 2), trial % 2000 - 1000);
    const long double exact = std::log(static_cast<long double>(value));
    ASSERT_LT(std::abs(logarithm(value) - exact), 4e-16 * std::max(1.0L, std::abs(exact))) << value;
  }
  EXPECT_EQ(logarithm(1.0), 0.0);
}

// What a machine that rounds as IEEE 754 says must get: a sum over the bits of many values.
TEST(PortableMathTest, SameBitsEverywhere) {
  std::mt19937_64 random(4);
  std::uint64_t sum = 0;
  const auto add = [&sum](double value) { sum = 31 * sum + std::bit_cast<std::uint64_t>(value); };
  for (int trial = 0; trial < kTrials; ++trial) {
    const double x = uniform(&random, -4, 4), y = uniform(&random, -4, 4);
    add(sin_cos(x).sin), add(sin_cos(x).cos), add(direction(x, y)), add(logarithm(std::abs(x) + 1e-3));
  }
  EXPECT_EQ(sum, 15731739126769811749u);
}

}  // namespace
}  // namespace swarm
