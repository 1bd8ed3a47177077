#include "swarm_sim/hosts/worker_threads.h"

#include <gtest/gtest.h>

#include <latch>
#include <stdexcept>
#include <string>
#include <vector>

namespace swarm::test {
namespace {

TEST(WorkerThreads, EachIsDoneOnce) {
  for (const int threads : {1, 2, 5}) {
    WorkerThreads workers(threads);
    for (const std::size_t n : {0u, 1u, 2u, 100u}) {
      std::vector<int> times(n);
      workers.for_each(n, [&](std::size_t i) { ++times[i]; });
      EXPECT_EQ(times, std::vector<int>(n, 1)) << threads << " threads, " << n;
    }
  }
}

// Each waits for the others: one after the other they would wait for ever.
TEST(WorkerThreads, SeveralAreAtWorkAtATime) {
  WorkerThreads workers(3);
  for (int round = 0; round < 100; ++round) {
    std::latch all(3);
    workers.for_each(3, [&](std::size_t) { all.arrive_and_wait(); });
  }
}

TEST(WorkerThreads, TheFirstThatFailedIsTold) {
  WorkerThreads workers(2);
  std::vector<int> times(10);
  const auto fails = [&](std::size_t i) {
    ++times[i];
    if (i == 3 || i == 7) throw std::runtime_error(std::to_string(i));
  };
  try {
    workers.for_each(times.size(), fails);
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "3");
  }
  EXPECT_EQ(times, std::vector<int>(10, 1));
  EXPECT_NO_THROW(workers.for_each(3, fails));  // it is forgotten
}

}  // namespace
}  // namespace swarm::test
