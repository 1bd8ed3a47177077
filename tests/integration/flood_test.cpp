// A broadcast daemon in floods of datagrams: its setpoints keep their rate.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <memory>
#include <numbers>
#include <string>
#include <thread>
#include <vector>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/node_clock.h"
#include "planner_daemon/coordination/deconfliction.h"
#include "tests/support/broadcast_robot.h"

namespace swarm::test {
namespace {

using Clock = std::chrono::steady_clock;

const std::string kOnboardUrl = local_url(base_port() + 60);
const std::string kSwarmUrl = "udpm://239.255.76.68:" + std::to_string(base_port() + 61) + "?ttl=0";

// Half a circle around a robot that hovers, then away from it.
Trajectory around(std::int32_t seq, Utime start, double radius_m) {
  constexpr int kPieces = 9;
  Trajectory around(seq, start, 1s, kPieces);
  for (int k = 0; k < kPieces; ++k) {
    const double rate = std::numbers::pi / kPieces;
    const Eigen::Vector3d out(std::cos(rate * k), std::sin(rate * k), 0), along(-out.y(), out.x(), 0);
    const Eigen::Vector3d place = radius_m * out + Eigen::Vector3d(0, 0, 1);
    around.set_knot(k, {place, radius_m * rate * along, -radius_m * rate * rate * out, Eigen::Vector3d::Zero()});
  }
  MotionState rests;
  rests.position = {-1, 0, 1};
  around.set_knot(kPieces, rests);
  return around;
}

// So close that it takes longest to see whether they touch.
double most_laborious_m() {
  const Utime start = kStart;
  const Motion hovers{Trajectory::hover(1, start, {0, 0, 1}), {}};
  double near_m = 0.4, far_m = 0.5;
  for (int i = 0; i < 50; ++i) {
    const double middle_m = (near_m + far_m) / 2;
    const Motion circles{around(1, start, middle_m), {}};
    const BroadcastConfig config;
    const double distance_m = 2 * config.radius_m + config.separation_m;
    (motions_separated(circles, hovers, start, distance_m, config.clock_error_s) ? far_m : near_m) = middle_m;
  }
  return far_m;
}

// Robot 0, which hovers, led by a broadcast daemon.
class Flooded : public ::testing::Test {
 protected:
  void SetUp() override {
#ifdef __SANITIZE_ADDRESS__
    GTEST_SKIP() << "the sanitizers take many times the time that the daemon has";
#endif
    const std::string key = write_text(directory_ / "key", SwarmKeys::fresh());
    std::filesystem::permissions(key, std::filesystem::perms::owner_read);
    std::vector<std::string> words = {"broadcast_daemon"};
    if (*SWARM_EMULATOR == '\0' && std::system("chrt -f 20 true 2> /dev/null") == 0)  // as its service runs it
      words = {"/usr/bin/prlimit",
               "--rttime=200000",
               "/usr/bin/chrt",
               "-f",
               "20",
               std::string(SWARM_BIN_DIR) + "/broadcast_daemon"};
    words.insert(words.end(), {"--robot-id=0", "--roster=0,1,2", "--key-file=" + key, "--onboard-url=" + kOnboardUrl,
                               "--swarm-url=" + kSwarmUrl});
    program_ = std::make_unique<Program>(words);
    onboard_ = std::make_unique<LcmBus>(kOnboardUrl);
    swarm_ = std::make_unique<LcmBus>(kSwarmUrl, SwarmKeys::read(key));
    onboard_->subscribe(channel::kSetpoint, [this](auto, auto bytes) {
      sogm_swarm::setpoint_t setpoint;
      if (decode(bytes, &setpoint) == Refusal::kNone) setpoints_.push_back(to_utime(setpoint.header.utime));
    });
    for (const auto end = Clock::now() + 5s; setpoints_.empty() && Clock::now() < end;) {
      ASSERT_TRUE(onboard_->publish(channel::kRobotState, encoded(state_at(0, {0, 0, 1}, 0, now()))));
      std::this_thread::sleep_for(20ms);
      onboard_->drain();
    }
    ASSERT_FALSE(setpoints_.empty()) << program_->err();
  }

  static Utime now() {
    return wall_utime();
  }

  // Between two setpoints, by the daemon's clock, at most, while `send` is called `rate_hz` times a second.
  Duration longest_gap(int rate_hz, const std::function<void()>& send) {
    std::atomic<bool> ends = false;
    std::thread flood([&] {
      const auto began = Clock::now();
      for (std::int64_t sent = 0; !ends; std::this_thread::sleep_for(1ms)) {
        for (const auto due = (Clock::now() - began) / 1us * rate_hz / 1'000'000; sent < due; ++sent) send();
      }
    });
    setpoints_.clear();
    for (const auto end = Clock::now() + kFlood; Clock::now() < end; std::this_thread::sleep_for(1ms))
      onboard_->drain();
    ends = true;
    flood.join();
    Duration longest{};
    for (std::size_t i = 1; i < setpoints_.size(); ++i) longest = std::max(longest, setpoints_[i] - setpoints_[i - 1]);
    return longest;
  }
  // A computer that others use as well may be late now and then; a flood that delays setpoints does so every time.
  void expect_steady_setpoints(int rate_hz, const std::function<void()>& send) {
    Duration longest{};
    for (int round = 0; round < 3; ++round) {
      longest = longest_gap(rate_hz, send);
      if (program_->wait(0.0)) FAIL() << "it ended: " << program_->err();
      if (longest <= kLongest && std::ssize(setpoints_) > 95 * (kFlood / 1s)) return;  // of 100 a second
    }
    if (longest_gap(0, [] {}) > kLongest) GTEST_SKIP() << "other programs take the processors";
    FAIL() << std::ssize(setpoints_) << " setpoints, " << longest / 1us << " us between two of them";
  }

  static constexpr auto kFlood = 3s, kLongest = 25ms;
  TemporaryDirectory directory_;
  std::unique_ptr<Program> program_;
  std::unique_ptr<LcmBus> onboard_, swarm_;
  std::vector<Utime> setpoints_;
};

TEST_F(Flooded, ByStrangers) {
  LcmBus unsealed(kSwarmUrl);
  Peer stranger{1, Trajectory::hover(1, now(), {3, 0, 1})};
  expect_steady_setpoints(20'000, [&] {
    (void)unsealed.publish(channel::kAnnouncement, packed(stranger.message(now(), 0)));
    (void)unsealed.drain();
  });
}

// A peer that has the key says what takes long to judge.
TEST_F(Flooded, ByAPeer) {
  Peer peer{1, Trajectory::hover(1, now(), {3, 0, 1})};
  const double laborious_m = most_laborious_m();
  expect_steady_setpoints(20'000, [&] {
    const auto seq = static_cast<std::int32_t>(peer.seq + 1);
    peer.pends(around(seq, now() + 100ms, laborious_m), now());
    (void)swarm_->publish(channel::kAnnouncement, packed(peer.message(now(), 0)));
  });
}

}  // namespace
}  // namespace swarm::test
