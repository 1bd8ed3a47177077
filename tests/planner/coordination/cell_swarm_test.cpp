// Robots that fly to and fro over many cells, with lossy links, crashes and silence: by the objects that fly, with
// planners that know nothing but straight lines.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <queue>
#include <random>

#include "planner_daemon/coordination/cell.h"
#include "planner_daemon/coordination/cell_keeper.h"
#include "planner_daemon/coordination/cell_protocol.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

class CellSwarm {
 public:
  struct Scene {
    int robots = 30;
    double loss = 0.1;
    int crashes = 0;  // robots that crash, one a second; every other one comes back after four
    Duration time = 20s;
  };

  explicit CellSwarm(const Scene& scene) : scene_(scene), edge_m_(std::sqrt(kArea_m2 * scene.robots)), random_(1) {
    const int columns = static_cast<int>(std::ceil(std::sqrt(scene.robots)));
    for (int id = 0; id < scene.robots; ++id) {
      robots_.push_back({make(id, 1)});
      const Eigen::Vector3d place(id % columns + 0.5, id / columns + 0.5, 0);
      robots_.back().protocol.start(
          {Trajectory::hover(1, kStart, place * edge_m_ / columns + Eigen::Vector3d::UnitZ()), {}});
      robots_.back().kept = robots_.back().protocol.state();
    }
  }

  void run() {
    for (now_ = kStart; now_ < kStart + scene_.time; now_ += kStep) {
      deliver();
      for (std::size_t i = 0; i < robots_.size(); ++i) live(i);
      for (auto& [cell, keeper] : keepers_) look_after(cell, keeper);
      if (now_ >= kStart + 5s && (now_ - kStart) % 1s == 0s) fail_and_return();
      look_for_touches();
    }
  }

  int touches() const { return touches_; }
  int commits(std::size_t i) const { return robots_[i].commits + robots_[i].protocol.robot().commits(); }
  bool is_dead(std::size_t i) const { return robots_[i].is_dead; }
  double heard_hz() const { return per_robot(heard_) / to_seconds(scene_.time); }
  double answers() const { return static_cast<double>(answers_) / static_cast<double>(said_); }
  Duration typical_delay() {
    std::ranges::sort(delays_);
    return delays_.empty() ? Duration() : delays_[delays_.size() / 2];
  }

 private:
  static constexpr Duration kStep = 10ms, kPeriod = 50ms, kLead = 600ms, kSilent = 2s;
  static constexpr double kArea_m2 = 25, kCell_m = 8, kFarthest_m = 6, kSpeed_mps = 2;

  struct Robot {
    CellProtocol protocol;
    CellAnnouncement kept{};
    std::int32_t boot = 1;
    std::int64_t announcements = 0;
    bool is_dead = false;
    int commits = 0;  // of earlier starts
    Utime proposed{};
    Eigen::Vector3d goal{};
    bool has_goal = false;
  };
  struct Keeper {
    CellKeeper keeper;
    std::map<int, Utime> heard{};
  };
  struct Datagram {
    Utime arrives;
    std::int64_t number;
    int to;  // -1: a keeper
    Cell cell;
    std::shared_ptr<const CellAnnouncement> announcement;
    std::shared_ptr<const CellRoster> roster;
    bool operator>(const Datagram& other) const {
      return std::pair(arrives, number) > std::pair(other.arrives, other.number);
    }
  };

  static CellProtocol make(int id, std::int32_t boot) {
    const auto cells_of = [](const Motion& motion, Utime from, double reach_m) {
      return cells_touched(motion, from, reach_m, kCell_m);
    };
    return CellProtocol({{id, boot, {}, 0.2, 0.02}, cells_of});
  }
  CellProtocol::Keep keeps(std::size_t i) {
    return [kept = &robots_[i].kept](const CellAnnouncement& promise) { return *kept = promise, true; };
  }
  double per_robot(std::int64_t count) const {
    return static_cast<double>(count) / static_cast<double>(robots_.size());
  }
  double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }

  void send(Datagram datagram) {
    if (uniform(0, 1) < scene_.loss) return;
    datagram.arrives = now_ + to_duration(uniform(0.01, 0.03));
    datagram.number = ++datagrams_;
    under_way_.push(std::move(datagram));
  }
  void deliver() {
    for (; !under_way_.empty() && under_way_.top().arrives <= now_; under_way_.pop()) {
      const Datagram& datagram = under_way_.top();
      if (datagram.to < 0) {
        auto [found, is_new] = keepers_.try_emplace(datagram.cell, Keeper{CellKeeper(CellKeeper::Book{datagram.cell})});
        found->second.heard[datagram.announcement->robot.header.robot_id] = now_;
        found->second.keeper.receive(*datagram.announcement, [](const CellKeeper::Book&) { return true; });
        continue;
      }
      Robot& robot = robots_[static_cast<std::size_t>(datagram.to)];
      if (robot.is_dead) continue;
      ++heard_;
      if (datagram.roster) robot.protocol.receive(*datagram.roster);
      const auto to = static_cast<std::size_t>(datagram.to);
      if (datagram.announcement) robot.protocol.receive(now_, *datagram.announcement, keeps(to));
      settle(to);
    }
  }
  void settle(std::size_t i) {
    Robot& robot = robots_[i];
    robot.protocol.advance(now_, keeps(i));
    if (!robot.protocol.robot().may_commit(now_)) return;
    if (robot.protocol.commit(keeps(i))) delays_.push_back(now_ - robot.proposed), robot.has_goal = false;
  }
  void live(std::size_t i) {
    Robot& robot = robots_[i];
    if (robot.is_dead) return;
    settle(i);
    if ((now_ - kStart) % kPeriod != kStep * (i % (kPeriod / kStep))) return;
    plan(i);
    auto message = std::make_shared<CellAnnouncement>(robot.protocol.state());
    message->robot.header = make_header(static_cast<int>(i), robot.boot, ++robot.announcements, now_);
    ++said_;
    answers_ += static_cast<std::int64_t>(message->acks.size());
    for (const auto& [cell, standing] : message->cells) {
      send({{}, 0, -1, cell, message, nullptr});
      tell(cell, static_cast<int>(i), message, nullptr);
    }
  }
  // All that listen in the cell.
  void tell(const Cell& cell, int from, const std::shared_ptr<const CellAnnouncement>& announcement,
            const std::shared_ptr<const CellRoster>& roster) {
    for (std::size_t j = 0; j < robots_.size(); ++j) {
      const int id = static_cast<int>(j);
      if (id != from && robots_[j].protocol.places().contains(cell)) send({{}, 0, id, cell, announcement, roster});
    }
  }
  // A straight line to somewhere near, once it rests.
  void plan(std::size_t i) {
    Robot& robot = robots_[i];
    const CommitProtocol& protocol = robot.protocol.robot();
    if (!protocol.pending().empty() || !protocol.rests(now_)) return;
    const Eigen::Vector3d here = protocol.motion()->at(now_).position;
    if (!robot.has_goal) {
      const Eigen::Vector3d step(uniform(-kFarthest_m, kFarthest_m), uniform(-kFarthest_m, kFarthest_m), 0);
      robot.goal = (here + step).cwiseMax(Eigen::Vector3d(0, 0, 1)).cwiseMin(Eigen::Vector3d(edge_m_, edge_m_, 1));
    }
    const Utime start = now_ + kLead;
    const double seconds = 1 + 1.875 * (robot.goal - here).norm() / kSpeed_mps;
    const Trajectory flight = quintic_to(protocol.motion()->at(start), start, robot.goal, seconds, 5);
    const Rejection rejection = robot.protocol.propose(now_, flight, keeps(i));
    robot.has_goal = rejection == Rejection::kWaiting || rejection == Rejection::kNone;
    if (rejection == Rejection::kNone) robot.proposed = now_;
  }
  void look_after(const Cell& cell, Keeper& keeper) {
    if ((now_ - kStart) % kPeriod != 0s) return;
    for (const auto& [id, heard] : keeper.heard)
      if (now_ - heard > kSilent) (void)keeper.keeper.expel(id, [](const CellKeeper::Book&) { return true; });
    tell(cell, -1, nullptr, std::make_shared<CellRoster>(keeper.keeper.roster()));
  }
  void fail_and_return() {
    const auto second = static_cast<int>((now_ - kStart) / 1s) - 5;
    if (second < scene_.crashes) robots_[static_cast<std::size_t>(second)].is_dead = true;
    const int back = second - 4;
    if (back < 0 || back >= scene_.crashes || back % 2 != 0) return;
    const auto i = static_cast<std::size_t>(back);
    Robot& robot = robots_[i];
    robot.commits = commits(i);
    robot.is_dead = robot.has_goal = false;
    robot.protocol = make(back, ++robot.boot);
    robot.protocol.start(motion_of(robot.kept.robot), 0, robot.kept.cells);
  }
  void look_for_touches() {
    std::map<Cell, Places> near;
    for (const Robot& robot : robots_) {
      const Eigen::Vector3d place = robot.protocol.robot().motion()->at(now_).position;
      const auto x = static_cast<int>(std::floor(place.x())), y = static_cast<int>(std::floor(place.y()));
      for (int dx = -1; dx <= 1; ++dx) {
        for (int dy = -1; dy <= 1; ++dy) {
          for (const Eigen::Vector3d& other : near[{x + dx, y + dy}]) touches_ += (place - other).norm() < 0.4;
        }
      }
      near[{x, y}].push_back(place);
    }
  }

  using Places = std::vector<Eigen::Vector3d>;
  Scene scene_;
  double edge_m_;
  std::mt19937_64 random_;
  Utime now_{};
  std::vector<Robot> robots_;
  std::map<Cell, Keeper> keepers_;
  std::priority_queue<Datagram, std::vector<Datagram>, std::greater<>> under_way_;
  std::int64_t datagrams_ = 0, said_ = 0, answers_ = 0, heard_ = 0;
  int touches_ = 0;
  std::vector<Duration> delays_;
};

void expect_flights(const CellSwarm::Scene& scene, double least_commits) {
  CellSwarm swarm(scene);
  swarm.run();
  int commits = 0, idle = 0, alive = 0;  // of those that live
  for (std::size_t i = 0; i < static_cast<std::size_t>(scene.robots); ++i) {
    if (swarm.is_dead(i)) continue;
    ++alive;
    commits += swarm.commits(i);
    idle += swarm.commits(i) == 0;
  }
  std::printf(
      "%d robots: heard %.0f datagrams a second each, %.1f answers an announcement, commit after %.0f ms, %.1f commits "
      "each\n",
      scene.robots, swarm.heard_hz(), swarm.answers(), 1e3 * to_seconds(swarm.typical_delay()), 1.0 * commits / alive);
  EXPECT_EQ(swarm.touches(), 0);
  EXPECT_GE(commits, least_commits * alive);
  EXPECT_EQ(idle, 0);
}

TEST(CellSwarm, FliesWithLosses) {
  expect_flights({}, 2);
}
TEST(CellSwarm, FliesWithCrashes) {
  expect_flights({.robots = 30, .loss = 0.3, .crashes = 6}, 1);
}
// Minutes. What each hears, says and waits for stays what it is.
TEST(CellSwarm, DISABLED_Grows) {
  for (const int robots : {20, 100, 300, 1000}) expect_flights({.robots = robots}, 2);
  expect_flights({.robots = 300, .loss = 0.3, .crashes = 12}, 1);
}

}  // namespace
}  // namespace swarm::test
