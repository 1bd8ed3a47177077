// Broadcasters in cells: where they listen and speak, whom they know, what they commit and when, with the keepers'
// node and each other on a bus that loses nothing.
#include <gtest/gtest.h>

#include <deque>
#include <memory>

#include "lcmtypes/bus/cell_channels.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/packed_cell_messages.h"
#include "planner_daemon/coordination/keeper_node.h"
#include "tests/support/broadcast_robot.h"

namespace swarm::test {
namespace {

class CellScene {
 public:
  explicit CellScene(const std::vector<Eigen::Vector3d>& places) : keepers_(KeeperConfig(), books_, 1) {
    promises_.resize(places.size());
    for (std::size_t i = 0; i < places.size(); ++i) start(i, places[i]);
    run_for(1.0);
  }

  void start(std::size_t i, const Eigen::Vector3d& place) {
    BroadcastConfig config;
    config.robot_id = static_cast<int>(i);
    config.cell_m = 8;
    robots_.resize(std::max(robots_.size(), i + 1));
    robots_[i] = std::make_unique<Bench<BroadcastNode>>(config, promises_[i], 1);
    robots_[i]->now = keepers_.now;
    robots_[i]->send(channel::kRobotState, state_at(static_cast<int>(i), place, 0, keepers_.now));
  }
  void crash(std::size_t i) { robots_[i].reset(); }
  Bench<BroadcastNode>& robot(std::size_t i) { return *robots_[i]; }
  Bench<KeeperNode>& keepers() { return keepers_; }

  void run_for(double seconds) {
    const Utime until = keepers_.now + to_duration(seconds);
    for (Utime now = keepers_.now + 1ms; now <= until; now += 1ms) {
      keepers_.run_until(now);
      for (const auto& robot : robots_)
        if (robot) robot->run_until(now);
      deliver();
    }
  }

  Trajectory flight(std::size_t i, const Eigen::Vector3d& to) {
    const Utime begins = keepers_.now + 500ms;
    const MotionState from = robot(i).node.motion()->at(begins);
    return quintic_to(from, begins, to, 1 + (to - from.position).norm(), 5);
  }
  void propose(std::size_t i, const Trajectory& trajectory) {
    candidate_t candidate{};
    candidate.header = make_header(static_cast<int>(i), 1, ++candidates_, keepers_.now);
    candidate.trajectory = trajectory.to_wire();
    candidate.trajectory.seq = 1;
    robot(i).send(channel::kCandidate, candidate);
  }
  std::function<void(const Mailbox::Letter&)> listener;  // to what is said between them
  int commits(std::size_t i) { return robot(i).node.protocol().commits(); }

 private:
  // What was said on the swarm bus, to all who listen there.
  void deliver() {
    std::vector<Mailbox::Letter> letters;
    const auto collect = [&](Mailbox& out) {
      for (const Mailbox::Letter& letter : out.letters)
        if (letter.bus == BusId::kSwarm) letters.push_back(letter);
      out.letters.clear();
    };
    collect(keepers_.out);
    for (const auto& robot : robots_)
      if (robot) collect(robot->out);
    for (const Mailbox::Letter& letter : letters) {
      if (listener) listener(letter);
      if (kind_of(letter.channel) == channel::kCellAnnouncement)
        keepers_.deliver(BusId::kSwarm, letter.channel, letter.bytes);
      for (const auto& robot : robots_)
        if (robot && robot->out.heard.contains(letter.channel))
          robot->deliver(BusId::kSwarm, letter.channel, letter.bytes);
    }
  }

  MemoryBookStore books_;
  Bench<KeeperNode> keepers_;
  std::deque<MemoryPromiseStore> promises_;
  std::vector<std::unique_ptr<Bench<BroadcastNode>>> robots_;
  std::int64_t candidates_ = 0;
};

TEST(BroadcastCells, KnowWhoSharesACellAndNobodyElse) {
  CellScene scene({{2, 2, 1}, {4, 4, 1}, {-4, -4, 1}});
  EXPECT_TRUE(scene.robot(0).node.protocol().peers().contains(1));
  EXPECT_FALSE(scene.robot(0).node.protocol().peers().contains(2));
  EXPECT_EQ(scene.robot(0).out.heard, heard_on({{0, 0}}));
  EXPECT_EQ(scene.robot(2).out.heard, heard_on({{-1, -1}}));
  EXPECT_EQ(scene.robot(0).node.refused().total(), 0);
}

// The first proposal is a wish; soon after, the same is committed, and the cell that was left is over.
TEST(BroadcastCells, AskForACellFlyThereAndLeaveTheOther) {
  CellScene scene({{2, 2, 1}, {4, 4, 1}, {-4, -4, 1}});
  scene.propose(0, scene.flight(0, {-4, 2, 1}));
  EXPECT_EQ(scene.robot(0).node.rejected(Rejection::kWaiting), 1);
  scene.run_for(0.1);
  scene.propose(0, scene.flight(0, {-4, 2, 1}));
  scene.run_for(0.1);
  EXPECT_EQ(scene.commits(0), 1);
  EXPECT_TRUE(scene.robot(1).node.protocol().peers().contains(0));
  scene.run_for(9.0);
  EXPECT_FALSE(scene.robot(1).node.protocol().peers().contains(0));
  EXPECT_EQ(scene.robot(0).out.heard, heard_on({{-1, 0}}));
}

TEST(BroadcastCells, SayOnceWhatIsForSeveralCells) {
  CellScene scene({{7.9, 2, 1}, {2, 2, 1}, {12, 2, 1}});
  std::map<std::string, int> said;
  scene.listener = [&said](const Mailbox::Letter& letter) { ++said[letter.channel]; };
  scene.run_for(1.0);
  EXPECT_NEAR(said["CELL_ANNOUNCEMENT_at_0_0_2x1"], 10, 2);
  EXPECT_FALSE(said.contains("CELL_ANNOUNCEMENT_at_0_0_1x2"));
  for (const std::size_t i : {1, 2}) EXPECT_TRUE(scene.robot(i).node.protocol().peers().at(0).hears_us) << i;
  EXPECT_EQ(scene.robot(0).node.protocol().peers().size(), 2u);
}

TEST(BroadcastCells, KeepOffEachOther) {
  CellScene scene({{2, 2, 1}, {6, 2, 1}});
  scene.propose(0, scene.flight(0, {5.9, 2, 1}));
  EXPECT_EQ(scene.robot(0).node.rejected(Rejection::kConflict), 1);
  scene.propose(0, scene.flight(0, {4, 2, 1}));
  scene.run_for(0.1);
  EXPECT_EQ(scene.commits(0), 1);
  scene.propose(1, scene.flight(1, {4.1, 2, 1}));
  EXPECT_EQ(scene.robot(1).node.rejected(Rejection::kConflict), 1);
}

// Who falls silent is expelled, and kept off where it may be; the planner is shown it there. It comes back by its
// promise.
TEST(BroadcastCells, GoOnAroundWhoIsSilentUntilItIsBack) {
  CellScene scene({{2, 2, 1}, {6, 2, 1}});
  scene.crash(1);
  scene.run_for(1.0);
  scene.propose(0, scene.flight(0, {2, 6, 1}));
  scene.run_for(0.4);
  EXPECT_EQ(scene.commits(0), 0);  // nobody answers for it
  scene.run_for(2.0);
  scene.propose(0, scene.flight(0, {5.9, 2, 1}));
  EXPECT_EQ(scene.robot(0).node.rejected(Rejection::kConflict), 1);
  scene.propose(0, scene.flight(0, {2, 6, 1}));
  scene.run_for(0.1);
  EXPECT_EQ(scene.commits(0), 1);
  scene.start(1, {6, 2, 1});
  scene.run_for(0.5);
  EXPECT_TRUE(scene.robot(0).node.protocol().peers().contains(1));
  scene.propose(1, scene.flight(1, {6, 6, 1}));
  scene.run_for(0.1);
  EXPECT_EQ(scene.commits(1), 1);
}

TEST(BroadcastCells, RefuseARosterAndCellsTogether) {
  BroadcastConfig config;
  config.cell_m = 8;
  verify(config);
  config.roster = {0, 1};
  EXPECT_THROW(verify(config), OptionError);
  config.roster.clear();
  config.cell_m = 0.5;
  EXPECT_THROW(verify(config), OptionError);
}

}  // namespace
}  // namespace swarm::test
