// The commit protocol, searched exhaustively on small cases: every order of proposals, deliveries, losses, crashes, of
// who gives up whom, and the passing of time. The objects searched are those that fly. Long because what may happen is
// to be read in one place, with the faults that must be found.
#include "planner_daemon/coordination/commit_protocol.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <optional>
#include <unordered_set>

#include "lcmtypes/bus/codec.h"
#include "planner_daemon/coordination/deconfliction.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

using sogm_swarm::ack_t;
using sogm_swarm::announcement_t;

constexpr Duration kTick = 1s;
constexpr double kRadius = 0.4, kSeparation = 0.02;

// What may happen, and how often.
struct Scope {
  std::vector<Eigen::Vector3d> sites;           // robots start at the first ones
  std::vector<std::vector<std::size_t>> goals;  // of each robot: sites
  int proposals = 2;                            // of each robot
  int ticks = 3;                                // of time; a flight starts a tick after its proposal and lasts one
  std::size_t copies = 2;                       // announcements under way from one robot to another: the newest ones
  int crashes = 0;
  int give_ups = 0;               // of all robots together, of whomever they like
  bool strangers = false;         // nobody has heard anybody yet
  int urgent = -1;                // the place of a robot that is always about to be hit; -1: none
  std::vector<Duration> ahead{};  // of each robot's clock; empty: of none
  Duration lead = kTick;          // from a proposal to the start of the flight
  // Faults, to see that they are found.
  bool forgets = false;          // a crash loses what was promised
  bool commits_unheard = false;  // who has the right of way waits for no majority
  bool knows_by_votes = false;   // to be given up by enough is enough, whatever they know of it
  bool drops_pending = false;    // of who was given up what was pending is forgotten
  bool ignores_starts = false;   // nor is it believed that it has started anew
};

class Swarm {
 public:
  explicit Swarm(const Scope& scope)
      : scope_(scope), n_(scope.goals.size()), links_(n_ * n_), delivered_(n_ * n_), known_(n_ * n_) {
    for (std::size_t i = 0; i < n_; ++i) {
      robots_.push_back({make(i, 1), {}, 1, scope.proposals});
      robots_[i].protocol.start({Trajectory::hover(1, kStart, scope.sites[i]), {}});
      keep(i);
    }
    for (std::size_t i = 0; i < n_; ++i) settle(i);
    if (!scope.strangers) deliver_all();
    crashes_ = scope.crashes;
    give_ups_ = scope.give_ups;
  }

  // Everything that can happen next.
  template <class Visit>
  void for_each_next(const Visit& visit) const {
    const auto after = [&](const auto& act) {
      Swarm next = *this;
      act(next);
      visit(next);
    };
    for (std::size_t i = 0; i < n_; ++i) {
      for (const std::size_t goal : scope_.goals[i]) {
        if (robots_[i].proposals > 0 && tick_ + 1 < scope_.ticks) after([&](Swarm& s) { s.propose(i, goal); });
      }
      for (std::size_t j = 0; j < n_; ++j) {
        for (std::size_t v = 0; v < link(i, j).size(); ++v) after([&](Swarm& s) { s.deliver(i, j, v); });
      }
      if (crashes_ > 0) after([&](Swarm& s) { s.crash(i); });
      for (std::size_t j = 0; j < n_ && scope_.give_ups > 0; ++j) {
        if (give_ups_ > 0 && may_give_up(i, j)) after([&](Swarm& s) { s.give_up(i, j); });
        for (std::size_t to = 0; to < n_; ++to)
          if (may_repeat(i, j, to)) after([&](Swarm& s) { s.repeat(i, j, to); });
      }
      const Trajectory& waits = robots_[i].protocol.pending();  // its last moment may come before any other event
      if (static_cast<int>(i) == scope_.urgent && !waits.empty() && waits.start_utime() == now(i) + kTick)
        after([&](Swarm& s) { s.settle(i, waits.start_utime() - 1us); });
    }
    if (tick_ < scope_.ticks) after([](Swarm& s) { s.tick(); });
  }

  // Two committed motions that meet; empty: none.
  std::string conflict() const {
    for (std::size_t i = 0; i < n_; ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        if (!motions_separated(flown(i), flown(j), kStart + tick_ * kTick, 2 * kRadius))
          return "robots " + std::to_string(i) + " and " + std::to_string(j) + " at tick " + std::to_string(tick_);
      }
    }
    return "";
  }

  // Whether everybody can still commit once the network is good again, and robot `dead`, if any, was given up: a hop
  // above its place, or away from whom it is too close to. So it may be that only a minority is left which knows what
  // the dead one may fly: that one rests.
  bool lives(std::optional<std::size_t> dead = {}) const {
    Swarm later = *this;
    later.dead_ = dead;
    for (int k = 0; k < 4; ++k) {  // whatever is pending is committed or withdrawn
      later.deliver_all();
      later.tick();
    }
    later.deliver_all();
    if (dead && !later.bury(*dead)) return true;
    for (std::size_t i = 0; i < n_; ++i) {
      if (i == dead) continue;
      const int before = later.robots_[i].protocol.commits();
      later.propose_to(i, later.place(i) + 0.1 * later.way_out(i));
      later.deliver_all();
      if (later.robots_[i].protocol.commits() != before + 1) return false;
      for (int k = 0; k < 2; ++k) {  // it is flown
        later.tick();
        later.deliver_all();
      }
    }
    return !dead || later.conflict().empty();
  }
  // Nobody can, or with any one of them dead.
  bool lives_without_any() const {
    if (!lives()) return false;
    for (std::size_t dead = 0; dead < n_ && scope_.give_ups > 0; ++dead)
      if (!lives(dead)) return false;
    return true;
  }

  int commits() const {
    int sum = 0;
    for (const Robot& robot : robots_) sum += robot.protocol.commits();
    return sum;
  }

  std::uint64_t key() const {
    std::uint64_t hash = 0xcbf29ce484222325ULL;
    const auto mix = [&hash](std::int64_t value) {
      hash = (hash ^ static_cast<std::uint64_t>(value)) * 0x9e3779b97f4a7c15ULL;
      hash ^= hash >> 29;
    };
    const auto mix_trajectory = [&](const Trajectory& trajectory) {
      mix(trajectory.seq());
      if (trajectory.empty()) return;
      mix(to_us(trajectory.start_utime()));
      for (const int knot : {0, trajectory.num_pieces()}) {
        for (int axis = 0; axis < 3; ++axis) mix(std::llround(100 * trajectory.knot(knot).position[axis]));
      }
    };
    const auto mix_message = [&](const announcement_t& m) {
      mix(m.header.boot), mix(m.pending_state), mix(m.pending_stamp);
      mix_trajectory(Trajectory::from_wire(m.committed));
      mix_trajectory(Trajectory::from_wire(m.pending));
    };
    // Announcements are compared by which is newer alone: of their numbers the order counts.
    const std::vector<std::vector<std::int64_t>> numbers = announcement_numbers();
    const auto rank = [&](std::size_t robot, std::int64_t seq) {
      return std::ranges::lower_bound(numbers[robot], seq) - numbers[robot].begin();
    };
    const auto mix_acks = [&](const std::vector<ack_t>& acks) {
      for (std::size_t j = 0; j < acks.size(); ++j) {
        mix(acks[j].peer_boot), mix(acks[j].verdict);
        mix(acks[j].verdict == ack_t::kGivenUp ? rank(j, acks[j].judged_seq) : acks[j].judged_seq);
      }
    };
    const auto mix_announcement = [&](const announcement_t& m) {
      mix_message(m), mix_acks(m.acks);
      if (scope_.give_ups > 0) mix(rank(static_cast<std::size_t>(m.header.robot_id), m.header.seq));
    };
    mix(tick_), mix(crashes_), mix(give_ups_);
    for (const Robot& robot : robots_) {
      mix(robot.proposals), mix(robot.boot);
      mix_message(robot.protocol.state()), mix_acks(robot.protocol.state().acks);
      for (const auto& [id, peer] : robot.protocol.peers()) {
        mix(peer.boot), mix(peer.hears_us), mix(to_us(peer.stamp)), mix(peer.judged_seq), mix(peer.verdict);
        mix(peer.our_seq), mix(peer.our_verdict);
        for (const Trajectory* t : {&peer.motion.committed, &peer.motion.next, &peer.pending}) mix_trajectory(*t);
        if (scope_.give_ups == 0) continue;
        const auto place = static_cast<std::size_t>(id);
        mix(peer.heard), mix(rank(place, peer.seq)), mix(peer.is_forgotten), mix(peer.given_up), mix_acks(peer.acks);
        mix(peer.given_up_boot), mix(rank(place, peer.given_up_seq));
      }
    }
    for (const auto& message : delivered_) {
      if (crashes_ > 0 && message) mix_announcement(*message);
    }
    for (const auto& versions : links_) {
      mix(static_cast<std::int64_t>(versions.size()));
      for (const announcement_t& version : versions) mix_announcement(version);
    }
    return hash;
  }

  // What may happen.
  void propose(std::size_t i, std::size_t site) {
    --robots_[i].proposals;
    propose_to(i, scope_.sites[site]);
  }
  void deliver(std::size_t from, std::size_t to, std::size_t version) {
    announcement_t message = link(from, to)[version];
    delivered_[from * n_ + to] = message;
    // Older ones are refused from now on.
    link(from, to).erase(link(from, to).begin(), link(from, to).begin() + static_cast<std::ptrdiff_t>(version) + 1);
    spoil(to, &message);
    CommitProtocol& protocol = robots_[to].protocol;
    ASSERT_TRUE(protocol.is_of_roster(message));
    protocol.receive(now(to), message, keeper(to));
    if (protocol.peers().at(static_cast<int>(from)).seq == message.header.seq) known_[from * n_ + to] = message;
    settle(to);
  }
  void crash(std::size_t i) {
    Robot& robot = robots_[i];
    --crashes_;
    ++robot.boot;
    Motion motion = motion_of(robot.kept);
    if (scope_.forgets) motion = {Trajectory::hover(1, now(i), motion.at(now(i)).position), {}};
    robot.protocol = make(i, robot.boot);
    robot.protocol.remember(robot.kept.roster_crc, robot.kept.acks);
    robot.protocol.start(motion);
    keep(i);
    robot.said.clear();
    for (std::size_t j = 0; j < n_; ++j) known_[j * n_ + i].reset();
    for (std::size_t j = 0; j < n_; ++j) {  // it does not know what it has heard: that may arrive once more
      if (j == i || j == dead_) continue;
      if (delivered_[j * n_ + i]) link(j, i).insert(link(j, i).begin(), *delivered_[j * n_ + i]);
      send(j, i);
    }
    settle(i);
  }
  void tick() {
    ++tick_;
    for (std::size_t i = 0; i < n_; ++i) settle(i);
  }
  bool may_give_up(std::size_t i, std::size_t j) const {
    if (i == j || i == dead_) return false;
    const CommitProtocol::Peer& peer = robots_[i].protocol.peers().at(static_cast<int>(j));
    return !peer.is_never_answered() && !peer.is_forgotten;
  }
  // These hear each other's newest, until they have no news.
  void talk(const std::vector<std::size_t>& robots) {
    for (bool any = true; any;) {
      any = false;
      for (const std::size_t i : robots) {
        for (const std::size_t j : robots) {
          if (link(i, j).empty()) continue;
          any = true;
          deliver(i, j, link(i, j).size() - 1);
        }
      }
    }
  }
  // Robot i gives robot j up, whether or not it lives.
  void give_up(std::size_t i, std::size_t j) {
    --give_ups_;
    ASSERT_TRUE(robots_[i].protocol.give_up(static_cast<int>(j), keeper(i)));
    if (scope_.drops_pending && known_[j * n_ + i]) {
      announcement_t& words = *known_[j * n_ + i];
      words.pending = {};
      words.pending_state = announcement_t::kNone;
      ++words.header.seq;
      robots_[i].protocol.learn(words, keeper(i));
    }
    settle(i);
  }
  bool may_repeat(std::size_t i, std::size_t j, std::size_t to) const {
    if (i == j || to == i || to == j || i == dead_ || to == dead_ || !known_[j * n_ + i]) return false;
    const auto& newest = known_[j * n_ + to];
    return robots_[i].protocol.must_repeat(static_cast<int>(j)) &&
           (!newest || newest->header.seq < known_[j * n_ + i]->header.seq);
  }
  // Robot i tells robot `to` the last words of robot j.
  void repeat(std::size_t i, std::size_t j, std::size_t to) {
    known_[j * n_ + to] = known_[j * n_ + i];
    robots_[to].protocol.learn(*known_[j * n_ + to], keeper(to));
    settle(to);
  }

 private:
  Eigen::Vector3d place(std::size_t i) const { return robots_[i].protocol.motion()->at(now(i)).position; }
  Eigen::Vector3d way_out(std::size_t i) const {
    for (std::size_t j = 0; j < n_; ++j) {
      const Eigen::Vector3d apart = place(i) - place(j);
      if (j != i && apart.norm() > 0.0 && apart.norm() < 2 * kRadius + kSeparation) return apart.normalized();
    }
    return Eigen::Vector3d::UnitZ();
  }
  struct Robot {
    CommitProtocol protocol;
    announcement_t kept;
    std::int32_t boot;
    int proposals;  // left
    std::vector<std::uint8_t> said{};
    std::int64_t announcements = 0;
  };

  CommitProtocol make(std::size_t i, std::int32_t boot) const {
    CommitProtocol::Rules rules{static_cast<int>(i), boot, {}, kRadius, kSeparation};
    for (const Duration ahead : scope_.ahead) rules.clock_error_s = std::max(rules.clock_error_s, to_seconds(ahead));
    for (std::size_t j = 0; j < n_; ++j) rules.roster.push_back(static_cast<int>(j));
    return CommitProtocol(rules);
  }
  Duration ahead(std::size_t i) const { return scope_.ahead.empty() ? 0us : scope_.ahead[i]; }
  Utime now(std::size_t i) const { return kStart + tick_ * kTick + ahead(i); }
  // What a robot is bound to, by a clock that is right.
  Motion flown(std::size_t i) const {
    Motion motion = *robots_[i].protocol.motion();
    motion.committed.shift(-ahead(i));
    motion.next.shift(-ahead(i));
    return motion;
  }
  std::vector<announcement_t>& link(std::size_t from, std::size_t to) { return links_[from * n_ + to]; }
  const std::vector<announcement_t>& link(std::size_t from, std::size_t to) const { return links_[from * n_ + to]; }
  void keep(std::size_t i) { robots_[i].kept = robots_[i].protocol.promise(); }
  CommitProtocol::Keep keeper(std::size_t i) {
    return [kept = &robots_[i].kept](const announcement_t& promise) {
      *kept = promise;
      return true;
    };
  }
  // What a faulty robot `to` makes of an announcement.
  void spoil(std::size_t to, announcement_t* message) const {
    const CommitProtocol& protocol = robots_[to].protocol;
    const std::int32_t waits = protocol.pending().seq();
    if (scope_.commits_unheard && waits > 0 && message->header.robot_id > static_cast<int>(to))
      message->acks[to] = {robots_[to].boot, waits, ack_t::kAck};
    for (std::size_t j = 0; j < n_; ++j) {
      ack_t& ack = message->acks[j];
      if (scope_.knows_by_votes && ack.verdict == ack_t::kGivenUp) ack.judged_seq = 0;
      if (!scope_.ignores_starts || j == to) continue;
      const auto& peer = protocol.peers().at(static_cast<int>(j));
      if (peer.given_up && ack.peer_boot > peer.boot) ack = {peer.boot, 0, ack_t::kGivenUp};
    }
  }
  std::vector<std::vector<std::int64_t>> announcement_numbers() const {
    std::vector<std::vector<std::int64_t>> numbers(n_);
    if (scope_.give_ups == 0) return numbers;
    for (const auto& versions : links_)
      for (const announcement_t& m : versions)
        numbers[static_cast<std::size_t>(m.header.robot_id)].push_back(m.header.seq);
    for (const Robot& robot : robots_) {
      for (const auto& [id, peer] : robot.protocol.peers()) {
        auto& of_peer = numbers[static_cast<std::size_t>(id)];
        of_peer.push_back(peer.seq), of_peer.push_back(peer.given_up_seq);
      }
    }
    for (auto& sorted : numbers) {
      std::ranges::sort(sorted);
      sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
    }
    return numbers;
  }
  // Robot `dead` is given up by all that can; false: those are too few.
  bool bury(std::size_t dead) {
    std::size_t votes = 0;
    for (std::size_t i = 0; i < n_; ++i) {
      if (may_give_up(i, dead)) give_up(i, dead);
    }
    for (std::size_t i = 0; i < n_; ++i) {
      for (std::size_t to = 0; to < n_; ++to)
        if (may_repeat(i, dead, to)) repeat(i, dead, to);
    }
    for (std::size_t i = 0; i < n_; ++i) {
      if (i != dead && robots_[i].protocol.peers().at(static_cast<int>(dead)).is_voted_out()) votes += i == 0 ? 3 : 2;
    }
    deliver_all();
    return 2 * votes > 2 * n_ + 1;
  }

  // What a node does after every event.
  void settle(std::size_t i) { settle(i, now(i)); }
  void settle(std::size_t i, Utime utime) {
    if (i == dead_) return;
    Robot& robot = robots_[i];
    robot.protocol.advance(utime);
    if (robot.protocol.is_given_up()) {
      robot.protocol.set_boot(++robot.boot);
      keep(i);
      robot.said.clear();
    }
    if (robot.protocol.may_commit(utime)) (void)robot.protocol.commit(keeper(i));
    // What has changed is said at once or by the next repetition, which may come at any time.
    std::vector<std::uint8_t> says = encoded(robot.protocol.state());
    if (says == robot.said) return;
    robot.said = std::move(says);
    ++robot.announcements;
    for (std::size_t j = 0; j < n_; ++j) {
      if (j != i) send(i, j);
    }
  }
  // What is under way is the newest: whatever is lost is repeated.
  void send(std::size_t from, std::size_t to) {
    announcement_t message = robots_[from].protocol.state();
    message.header = make_header(static_cast<int>(from), robots_[from].boot, robots_[from].announcements, now(from));
    link(from, to).push_back(message);
    if (link(from, to).size() > scope_.copies) link(from, to).erase(link(from, to).begin());
  }
  void propose_to(std::size_t i, const Eigen::Vector3d& to) {
    Robot& robot = robots_[i];
    const Utime start = now(i) + scope_.lead;
    const Trajectory flight = quintic_to(robot.protocol.motion()->at(start), start, to, 1.0, 1);
    const bool urgent = static_cast<int>(i) == scope_.urgent;
    (void)robot.protocol.propose(now(i), flight, urgent);
    settle(i);
  }
  void deliver_all() {
    std::vector<std::size_t> all;
    for (std::size_t i = 0; i < n_; ++i)
      if (i != dead_) all.push_back(i);
    talk(all);
  }

  Scope scope_;
  std::size_t n_;
  std::vector<Robot> robots_;
  std::vector<std::vector<announcement_t>> links_;        // announcements under way
  std::vector<std::optional<announcement_t>> delivered_;  // the newest of each link
  std::vector<std::optional<announcement_t>> known_;      // also from others, and not before a crash
  std::optional<std::size_t> dead_;                       // its broadcaster: the robot flies to the end of its motion
  int tick_ = 0, crashes_ = 0, give_ups_ = 0;
};

struct Found {
  std::int64_t states = 0, commits = 0;
  std::string conflict;   // the first, empty: none
  std::int64_t dead = 0;  // states from which somebody cannot commit any more, among those looked at
};

// Depth first; every state once.
class Search {
 public:
  // Ends at the first conflict, unless it shall go on.
  explicit Search(int liveness_share, bool goes_on = false) : liveness_share_(liveness_share), goes_on_(goes_on) {}
  Found all_of(const Swarm& start) {
    visit(start);
    return found_;
  }

 private:
  void visit(const Swarm& state) {
    if ((!found_.conflict.empty() && !goes_on_) || !seen_.insert(state.key()).second) return;
    if (found_.conflict.empty()) found_.conflict = state.conflict();
    found_.commits += state.commits();
    if (found_.states++ % liveness_share_ == 0 && (found_.conflict.empty() || goes_on_))
      found_.dead += !state.lives_without_any();
    state.for_each_next([this](const Swarm& next) { visit(next); });
  }

  int liveness_share_;
  bool goes_on_;
  std::unordered_set<std::uint64_t> seen_;
  Found found_;
};

// The robots start on the first ones; the fourth lies between them, beyond the third.
const std::vector<Eigen::Vector3d> kSites = {{0, 0, 1}, {2, 0, 1}, {1, 1.2, 1}, {1, -1.2, 1}};
const std::vector<std::vector<std::size_t>> kSwap = {{1, 2}, {0, 2}};   // two robots change places, or step aside
const std::vector<std::vector<std::size_t>> kGather = {{3}, {3}, {3}};  // three robots want the same place

Found search(const Scope& scope) {
  const Found found = Search(101).all_of(Swarm(scope));
  std::printf("%lld states\n", static_cast<long long>(found.states));
  return found;
}

void expect_safe(const Scope& scope, std::int64_t at_least) {
  const Found found = search(scope);
  EXPECT_EQ(found.conflict, "");
  EXPECT_EQ(found.dead, 0) << "states from which somebody can never commit again";
  EXPECT_GT(found.commits, 0);
  EXPECT_GE(found.states, at_least);
}

TEST(CommitProtocol, TwoRobotsWithStaleCopies) {
  expect_safe({.sites = kSites, .goals = kSwap, .ticks = 4, .copies = 3}, 17'000);
}

TEST(CommitProtocol, TwoRobotsAndACrash) {
  expect_safe({.sites = kSites, .goals = kSwap, .ticks = kSanitized ? 3 : 4, .crashes = 1},
              kSanitized ? 46'000 : 144'000);
}

TEST(CommitProtocol, TwoRobotsAndTwoCrashes) {
  expect_safe({.sites = kSites, .goals = kSwap, .ticks = 2, .crashes = 2}, 54'000);
}

TEST(CommitProtocol, TwoRobotsThatMeet) {
  expect_safe({.sites = kSites, .goals = kSwap, .ticks = 4, .strangers = true}, 14'000);
  expect_safe({.sites = kSites, .goals = kSwap, .ticks = 3, .crashes = 1, .strangers = true}, 48'000);
}

// A flight starts as soon as it may; by the clock of who is to agree it starts at the very moment.
TEST(CommitProtocol, TwoRobotsWhoseClocksDiffer) {
  const auto scope = [](Duration first, Duration second) {
    return Scope{.sites = kSites, .goals = kSwap, .ticks = 3, .crashes = 1, .ahead = {first, second}, .lead = 20ms};
  };
  expect_safe(scope(20ms, 0us), 5'000);
  expect_safe(scope(0us, 20ms), 5'000);
}

TEST(CommitProtocol, ThreeRobotsOverLossyLinks) {
  expect_safe({.sites = kSites, .goals = kGather, .proposals = 1, .ticks = 2, .copies = 1}, 24'000);
}

// Minutes each.
TEST(CommitProtocol, DISABLED_ThreeRobotsOfWhichOneIsGivenUpInTheWay) {
  expect_safe({.sites = kSites, .goals = {{3}, {3}, {}}, .proposals = 1, .ticks = 2, .copies = 1, .give_ups = 1},
              1'000'000);
}
TEST(CommitProtocol, DISABLED_ThreeRobotsThatGiveUpEachOther) {
  expect_safe({.sites = kSites, .goals = {{}, {}, {3}}, .proposals = 1, .ticks = 2, .copies = 1, .give_ups = 2},
              1'900'000);
}
TEST(CommitProtocol, DISABLED_ThreeRobotsAndACrash) {
  expect_safe({.sites = kSites, .goals = kGather, .proposals = 1, .ticks = 2, .copies = 1, .crashes = 1}, 1'500'000);
}
TEST(CommitProtocol, DISABLED_TwoRobotsWithStaleCopiesAndTwoCrashes) {
  expect_safe({.sites = kSites, .goals = kSwap, .ticks = 4, .copies = 3, .crashes = 2}, 1'900'000);
}

// Whoever likes gives up whomever it likes, whether or not it lives, and who was given up comes back.
TEST(CommitProtocol, TwoRobotsThatGiveUpEachOther) {
  expect_safe({.sites = kSites, .goals = kSwap, .ticks = 3, .give_ups = 1}, 60'000);
  expect_safe({.sites = kSites, .goals = kSwap, .ticks = 2, .give_ups = 2}, 50'000);
}

TEST(CommitProtocol, TwoRobotsThatGiveUpAndCrash) {
  expect_safe({.sites = kSites, .goals = kSwap, .ticks = 2, .crashes = 1, .give_ups = 1}, 120'000);
}

TEST(CommitProtocol, ThreeRobotsOfWhichOneIsGivenUp) {
  expect_safe({.sites = kSites, .goals = {{3}, {}, {}}, .proposals = 1, .ticks = 2, .copies = 1, .give_ups = 1},
              100'000);
}

// What the rules are there for is missed when it is not kept.
TEST(CommitProtocol, FaultsAreFound) {
  const Scope sound{.sites = kSites, .goals = kSwap, .ticks = 4, .crashes = 1};
  Scope forgets = sound;
  forgets.forgets = true;
  Scope drops_pending{.sites = kSites, .goals = kSwap, .ticks = 3, .give_ups = 1, .drops_pending = true};
  for (const Scope& faulty : {forgets, drops_pending}) EXPECT_NE(search(faulty).conflict, "");
}

// Of three robots it takes so many turns that a search would last: they are told. With the fault two robots meet.
void expect_fault(bool Scope::*fault, const std::function<void(Swarm&)>& story) {
  for (const bool faulty : {false, true}) {
    Scope scope{.sites = kSites, .goals = kGather, .give_ups = 4};
    scope.*fault = faulty;
    Swarm swarm(scope);
    story(swarm);
    EXPECT_EQ(swarm.conflict() != "", faulty) << swarm.conflict();
    EXPECT_TRUE(faulty || swarm.lives());
  }
}

TEST(CommitProtocol, WhoMayBeGivenUpIsHeardByAMajorityBeforeItCommits) {
  expect_fault(&Scope::commits_unheard, [](Swarm& swarm) {
    swarm.propose(0, 3);
    swarm.give_up(1, 0), swarm.give_up(2, 0);
    swarm.talk({1, 2});
    swarm.deliver(1, 0, 0), swarm.deliver(2, 0, 0);
    swarm.propose(1, 3);
    swarm.talk({1, 2});
  });
}

// Robot 2 has flown on with robot 1 alone: robot 0 must learn of it before it counts on its absence.
TEST(CommitProtocol, WhoCountsOnAnAbsenceKnowsTheLastWords) {
  expect_fault(&Scope::knows_by_votes, [](Swarm& swarm) {
    swarm.give_up(1, 0), swarm.give_up(2, 0);
    swarm.talk({1, 2});
    swarm.propose(2, 3);
    swarm.talk({1, 2});
    swarm.give_up(1, 2), swarm.give_up(0, 2);
    swarm.talk({0, 1});
    swarm.propose(0, 3);
    swarm.talk({0, 1});
  });
}

// Robots 0 and 2 have given each other up and come back, and robot 1 alone hears both.
TEST(CommitProtocol, WhoComesBackIsWaitedForAgain) {
  expect_fault(&Scope::ignores_starts, [](Swarm& swarm) {
    swarm.give_up(0, 2), swarm.give_up(1, 2);
    swarm.talk({0, 1});
    swarm.talk({1, 2});
    swarm.give_up(1, 0), swarm.give_up(2, 0);
    swarm.talk({1, 2});
    if (swarm.may_repeat(1, 0, 2)) swarm.repeat(1, 0, 2);
    swarm.talk({0, 1});
    swarm.propose(0, 3);
    swarm.talk({0, 1});
    swarm.propose(2, 3);
    swarm.talk({1, 2});
  });
}

// Forced commits can meet others, which is why they are the last resort; but not those of the holder, and whatever has
// met comes apart again.
TEST(CommitProtocol, TwoRobotsOfWhichOneIsInDanger) {
  expect_safe({.sites = kSites, .goals = kSwap, .ticks = 4, .urgent = 0}, 13'000);
  const Found found = Search(7, true).all_of(Swarm({.sites = kSites, .goals = kSwap, .ticks = 3, .urgent = 1}));
  EXPECT_NE(found.conflict, "");
  EXPECT_EQ(found.dead, 0);
  EXPECT_GT(found.states, 1'000);
}

}  // namespace
}  // namespace swarm::test
