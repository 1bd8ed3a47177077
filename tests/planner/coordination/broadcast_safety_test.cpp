// The promise of the commit protocol: whatever the network does and whoever crashes, no two committed motions ever
// meet.
#include <functional>
#include <memory>
#include <queue>
#include <random>

#include "lcmtypes/bus/channels.h"
#include "planner_daemon/coordination/broadcast_node.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

using sogm_swarm::candidate_t;
using sogm_swarm::setpoint_t;

// Robots with random planners that like to fly at each other, over a network that delays, loses, doubles and reorders.
class RandomSwarm {
 public:
  RandomSwarm(std::uint64_t seed, int robots) : random_(seed) {
    static constexpr Duration kDelays[] = {1ms, 20ms, 100ms, 300ms};
    max_delay_ = kDelays[random_() % 4];
    max_loss_ = uniform(0.0, 0.8);
    std::vector<int> roster;
    for (int i = 0; i < robots; ++i) roster.push_back(i);
    for (int i = 0; i < robots; ++i) {
      BroadcastConfig config;
      config.robot_id = i;
      config.roster = roster;
      config.radius_m = uniform(0.1, 0.3);
      config.limits.v_max_mps = 100;
      config.limits.a_max_mps2 = 1000;
      robots_.push_back(std::make_unique<Member>(*this, i, config));
      links_.emplace_back();
      for (int j = 0; j < robots; ++j) {
        const bool dies = uniform(0, 1) < 0.1;
        links_.back().push_back({uniform(0, max_loss_), dies ? kStart + 10s : kNever});
      }
    }
  }

  void run(double seconds) {
    for (auto& robot : robots_) {
      const Eigen::Vector3d place(robot->id % 2 - 0.5, robot->id / 2 - 0.5, 1.0);
      now_ = kStart;
      robot->deliver(BusId::kOnboard, channel::kRobotState, encoded(state_at(robot->id, place, 0, now_)));
    }
    const Utime end = kStart + to_duration(seconds);
    for (Utime tick = kStart + 10ms; tick <= end && !testing::Test::HasFailure(); tick += 10ms) {
      run_until(tick);
      judge_flight();
      for (auto& robot : robots_) maybe_plan(*robot);
    }
  }

  int commits() const {
    int total = 0;
    for (const auto& robot : robots_) total += robot->commits_before + robot->node->protocol().commits();
    return total;
  }
  int restarts() const { return restarts_; }
  int withdrawn() const {
    return sum([](const BroadcastNode& node) { return node.protocol().withdrawn(); });
  }
  int conflicts() const {
    return sum([](const BroadcastNode& node) { return node.rejected(Rejection::kConflict); });
  }
  std::string describe() const {
    std::ostringstream text;
    text << robots_.size() << " robots, delay up to " << max_delay_.count() << " us, loss up to " << max_loss_ << ", "
         << to_seconds(now_ - kStart) << " s after the start";
    return text.str();
  }

 private:
  struct Member : Outbox {
    Member(RandomSwarm& swarm_in, int id_in, const BroadcastConfig& config_in)
        : swarm(swarm_in), id(id_in), radius_m(config_in.radius_m), config(config_in) {
      node.emplace(config, promises, 1);
    }

    void publish_bytes(BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes) override {
      if (bus == BusId::kSwarm) swarm.broadcast(id, {bytes.begin(), bytes.end()});
      if (channel != channel::kSetpoint) return;
      ASSERT_EQ(decode(bytes, &setpoint), Refusal::kNone);
    }
    void deliver(BusId bus, const char* channel, const Bytes& bytes) {
      if (down()) return;
      node->on_message(swarm.now_, bus, channel, bytes, *this);
      step();
    }
    void step() {
      if (swarm.now_ >= up_again) restart();
      wake = node->step(swarm.now_, *this);
      if (node->protocol().commits() == commits_judged) return;
      commits_judged = node->protocol().commits();
      swarm.judge_commit(*this);
    }
    bool down() const { return up_again != kNever; }
    // The robot flies on as it was bound to.
    void crash(Utime until) {
      bound_to = *node->motion();
      up_again = wake = until;
    }
    void restart() {
      commits_before += node->protocol().commits();
      ++swarm.restarts_;
      node.emplace(config, promises, 1);
      up_again = kNever;
      commits_judged = 0;
      const Eigen::Vector3d place = bound_to.at(swarm.now_).position;
      node->on_message(swarm.now_, BusId::kOnboard, channel::kRobotState, encoded(state_at(id, place, 0, swarm.now_)),
                       *this);
    }
    const Motion& motion() const { return down() ? bound_to : *node->motion(); }

    RandomSwarm& swarm;
    int id;
    double radius_m;
    BroadcastConfig config;
    MemoryPromiseStore promises;
    std::optional<BroadcastNode> node;
    Motion bound_to;
    setpoint_t setpoint{};
    Utime wake = kStart, branch{}, up_again = kNever;
    std::int64_t candidate_seq = 0;
    int commits_judged = 0, commits_before = 0;
  };
  struct Link {
    double loss;
    Utime dies;
  };
  struct Packet {
    Utime time;
    std::int64_t number;
    int to;
    Bytes bytes;
    bool operator>(const Packet& other) const { return std::pair(time, number) > std::pair(other.time, other.number); }
  };

  double uniform(double low, double high) { return std::uniform_real_distribution<>(low, high)(random_); }
  int sum(const std::function<int(const BroadcastNode&)>& count) const {
    int total = 0;
    for (const auto& robot : robots_) total += count(*robot->node);
    return total;
  }

  void broadcast(int from, const Bytes& bytes) {
    for (int to = 0; to < static_cast<int>(robots_.size()); ++to) {
      const Link& link = links_[static_cast<std::size_t>(from)][static_cast<std::size_t>(to)];
      const int copies = uniform(0, 1) < 0.1 ? 2 : 1;
      for (int i = 0; i < copies; ++i) {
        if (to == from || uniform(0, 1) < link.loss || now_ >= link.dies) continue;
        const Duration delay = to_duration(uniform(0, to_seconds(max_delay_)));
        packets_.push({now_ + delay, next_packet_++, to, bytes});
      }
    }
  }

  void run_until(Utime tick) {
    while (true) {
      const auto next = std::min_element(robots_.begin(), robots_.end(),
                                         [](const auto& a, const auto& b) { return a->wake < b->wake; });
      const Utime arrival = packets_.empty() ? kNever : packets_.top().time;
      if (std::min(arrival, (*next)->wake) > tick) break;
      now_ = std::min(arrival, (*next)->wake);
      if (arrival <= (*next)->wake) {
        const Packet packet = packets_.top();
        packets_.pop();
        robots_[static_cast<std::size_t>(packet.to)]->deliver(BusId::kSwarm, channel::kAnnouncement, packet.bytes);
      } else {
        (*next)->step();
      }
    }
    now_ = tick;
  }

  void maybe_plan(Member& robot) {
    if (robot.down()) return;
    if (uniform(0, 1) < 0.0003) robot.crash(now_ + to_duration(uniform(0, 0.5)));
    if (robot.down() || !robot.motion().next.empty() || (now_ < robot.branch && uniform(0, 1) > 0.01)) return;
    const Duration lead = to_duration(uniform(1e-3, 0.05 + 2.5 * to_seconds(max_delay_)));
    robot.branch = now_ + lead;
    Eigen::Vector3d target(uniform(-1.3, 1.3), uniform(-1.3, 1.3), uniform(0.7, 1.3));
    const Member& prey = *robots_[random_() % robots_.size()];
    if (&prey != &robot && uniform(0, 1) < 0.4) {  // close to where another will be
      target = prey.motion().at(robot.branch + 1s).position;
      target += (robot.radius_m + prey.radius_m) * uniform(0.9, 1.3) *
                Eigen::Vector3d(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)).normalized();
    }
    candidate_t candidate{};
    candidate.header = make_header(robot.id, 1, robot.candidate_seq++, now_);
    const MotionState from = robot.motion().at(robot.branch);
    const int pieces = 1 + static_cast<int>(random_() % 5);
    candidate.trajectory = quintic_to(from, robot.branch, target, uniform(0.4, 1.5), pieces).to_wire();
    robot.deliver(BusId::kOnboard, channel::kCandidate, encoded(candidate));
  }

  Eigen::Vector3d place(std::size_t i) const { return robots_[i]->motion().at(now_).position; }

  void judge_flight() {
    for (std::size_t i = 0; i < robots_.size(); ++i) {
      if (!robots_[i]->down()) {
        ASSERT_EQ(to_utime(robots_[i]->setpoint.header.utime), now_) << "no setpoint";
        ASSERT_LT((Eigen::Vector3d(robots_[i]->setpoint.position) - place(i)).norm(), 1e-6);
      }
      for (std::size_t j = 0; j < i; ++j) {
        const double distance = (place(i) - place(j)).norm();
        ASSERT_GE(distance, robots_[i]->radius_m + robots_[j]->radius_m) << "robots " << i << " and " << j << " met";
      }
    }
  }

  // All robots are known here as they really are: what was committed must stay clear of them for ever.
  void judge_commit(const Member& robot) {
    const Motion& motion = robot.motion();
    for (const auto& other : robots_) {
      if (other->id == robot.id) continue;
      const Motion& theirs = other->motion();
      const Utime end = std::max(motion.end_utime(), theirs.end_utime());
      for (Utime t = motion.next.start_utime(); t <= end + 10ms; t += 10ms) {
        const double distance = (motion.at(t).position - theirs.at(t).position).norm();
        ASSERT_GE(distance, robot.radius_m + other->radius_m) << "robot " << robot.id << " committed what meets robot "
                                                              << other->id << " at " << to_seconds(t - kStart) << " s";
      }
    }
  }

  std::mt19937_64 random_;
  Utime now_ = kStart;
  Duration max_delay_{};
  std::int64_t next_packet_ = 0;
  double max_loss_ = 0.0;
  int restarts_ = 0;
  std::vector<std::unique_ptr<Member>> robots_;
  std::vector<std::vector<Link>> links_;  // [from][to]
  std::priority_queue<Packet, std::vector<Packet>, std::greater<>> packets_;
};

TEST(BroadcastSafety, NoNetworkMakesCommittedMotionsMeet) {
  constexpr int kSeeds = kSanitized ? 12 : 120;
  std::int64_t commits = 0, withdrawn = 0, conflicts = 0, restarts = 0;
  for (int seed = 1; seed <= kSeeds && !HasFailure(); ++seed) {
    RandomSwarm swarm(static_cast<std::uint64_t>(seed), 3 + seed % 2);
    swarm.run(20.0);
    EXPECT_GT(swarm.commits(), 0) << "seed " << seed;
    EXPECT_FALSE(HasFailure()) << "seed " << seed << ": " << swarm.describe();
    commits += swarm.commits();
    withdrawn += swarm.withdrawn();
    conflicts += swarm.conflicts();
    restarts += swarm.restarts();
  }
  std::printf("%lld commits, %lld withdrawn, %lld conflicts, %lld restarts\n", static_cast<long long>(commits),
              static_cast<long long>(withdrawn), static_cast<long long>(conflicts), static_cast<long long>(restarts));
  EXPECT_GT(commits, kSeeds * 100);
  EXPECT_GT(withdrawn, kSeeds * 10);
  EXPECT_GT(conflicts, kSeeds * 50);
  EXPECT_GT(restarts, kSeeds);
}

}  // namespace
}  // namespace swarm::test
