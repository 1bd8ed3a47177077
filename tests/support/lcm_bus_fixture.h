// What tests of real buses stand on: URLs of their own, and skipping where there is no multicast.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/time.h"

namespace swarm::test {

using Clock = std::chrono::steady_clock;
using Bytes = std::vector<std::uint8_t>;

// Buses of their own for each test process; several test runs may share the computer.
inline std::string test_url(int index, const std::string& more = "") {
  const int port = 20000 + (static_cast<int>(::getpid()) * 8 + index) % 40000;
  return "udpm://239.255.76.67:" + std::to_string(port) + "?ttl=0" + more;
}

inline bool wait_until(LcmBus& bus, const std::function<bool()>& done, Duration limit = 5s) {
  for (const auto end = Clock::now() + limit; !done() && Clock::now() < end;) {
    if (bus.drain() == 0) std::this_thread::sleep_for(1ms);
  }
  return done();
}

// Where the computer has no multicast at all there is nothing to try; any other failure is one.
class LcmBusTest : public testing::Test {
 protected:
  void SetUp() override {
    try {
      LcmBus bus(test_url(0));
    } catch (const std::runtime_error& error) {
      if (std::string(error.what()).find("ip route add") != std::string::npos) GTEST_SKIP() << error.what();
      throw;
    }
  }
};

}  // namespace swarm::test
