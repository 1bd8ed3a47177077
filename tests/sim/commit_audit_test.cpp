// The audit of committed motions: what it must find, what it must not, and logs of flights.
#include "swarm_sim/results/commit_audit.h"

#include <gtest/gtest.h>

#include "lcmtypes/bus/channels.h"
#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/world/world_generator.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

using sogm_swarm::ack_t;
using sogm_swarm::announcement_t;

Bytes announcement(int robot, std::int64_t seq, const Trajectory& committed, const Trajectory& pending = {},
                   std::int8_t state = announcement_t::kNone, std::int32_t boot = 1, std::int32_t forced_seq = 0,
                   Utime pending_stamp = kStart) {
  announcement_t message{};
  message.header = make_header(robot, boot, seq, kStart + seq * 1ms);
  message.radius = 0.2f;
  message.committed = committed.to_wire();
  message.pending = pending.to_wire();
  message.pending_state = state;
  message.pending_stamp = state == announcement_t::kNone ? 0 : to_us(pending_stamp);
  message.forced_seq = forced_seq;
  message.num_acks = 2;
  message.acks = {{-1, 0, ack_t::kNone}, {-1, 0, ack_t::kNone}};
  return packed(message);
}

const Trajectory kHover0 = Trajectory::hover(1, kStart, {0, 0, 1}), kHover1 = Trajectory::hover(1, kStart, {2, 0, 1});

Trajectory flight(const Trajectory& from, const Eigen::Vector3d& to) {
  return quintic_to(from.at(kStart), kStart + 100ms, to, 1.0, 2, 2);
}

TEST(CommitAudit, FindsWhatMeetsOnceItIsCommitted) {
  const Trajectory into = flight(kHover0, {1.61, 0, 1}), beside = flight(kHover0, {1.59, 0, 1});
  CommitAudit audit;
  audit.hear(announcement(0, 0, kHover0));
  audit.hear(announcement(1, 0, kHover1));
  audit.hear(announcement(0, 1, kHover0, into, announcement_t::kAnnounced));
  EXPECT_TRUE(audit.conflicts().empty());  // only announced
  audit.hear(announcement(0, 3, kHover0, beside, announcement_t::kCommitted));
  EXPECT_TRUE(audit.conflicts().empty());
  EXPECT_EQ(audit.motions(), 3);
  audit.hear(announcement(0, 2, kHover0, into, announcement_t::kCommitted));  // older than what is known
  EXPECT_TRUE(audit.conflicts().empty());
  audit.hear(announcement(1, 1, flight(kHover1, {1.9, 0, 1})));  // into the other's hover tail
  ASSERT_EQ(audit.conflicts().size(), 1u);
  EXPECT_EQ(audit.conflicts()[0].robot, 1);
  EXPECT_EQ(audit.conflicts()[0].other, 0);
  EXPECT_EQ(audit.conflicts()[0].other_seq, 2);
  audit.hear(Bytes{1, 2, 3});
  EXPECT_EQ(audit.motions(), 4);
}

// What robots announce to keep for their errors besides is not promised.
TEST(CommitAudit, HoldsRobotsToWhatTheyAreWithoutTheirErrors) {
  const auto hover = [](int robot, std::int64_t seq, double x, float radius) {
    announcement_t message;
    EXPECT_EQ(decode_packed(
                  announcement(robot, seq, Trajectory::hover(static_cast<std::int32_t>(seq) + 1, kStart, {x, 0, 1})),
                  &message),
              Refusal::kNone);
    message.radius = radius;
    return packed(message);
  };
  CommitAudit audit;
  audit.hear(hover(0, 0, 0.0, 0.2f));
  audit.hear(hover(1, 0, 0.5, 0.2f));
  audit.hear(hover(0, 1, 0.0, 0.5f));
  audit.hear(hover(1, 1, 0.45, 0.5f));
  EXPECT_TRUE(audit.conflicts().empty());
  audit.hear(hover(1, 2, 0.35, 0.5f));
  EXPECT_EQ(audit.conflicts().size(), 1u);
}

TEST(CommitAudit, ARestartThatCountsFromTheBeginningIsAudited) {
  CommitAudit audit;
  audit.hear(announcement(0, 0, kHover0));
  audit.hear(announcement(1, 5, kHover1));
  audit.hear(announcement(1, 0, Trajectory::hover(1, kStart, {0.3, 0, 1}), {}, announcement_t::kNone, 2));
  EXPECT_EQ(audit.conflicts().size(), 1u);
}

// From its announcement until the robot itself first says that it is committed; once for each, also where it starts
// anew.
TEST(CommitAudit, TellsHowLongCommitsTook) {
  const Trajectory hop = flight(kHover0, {0.1, 0, 1});
  CommitAudit audit;
  const auto hear_own = [&audit](const Bytes& announced) {
    announcement_t message;
    ASSERT_EQ(decode_packed(announced, &message), Refusal::kNone);
    audit.hear_own(encoded(message));
  };
  hear_own(announcement(0, 4, kHover0, hop, announcement_t::kAnnounced));
  EXPECT_TRUE(audit.delays_ms().empty());
  hear_own(announcement(0, 7, kHover0, hop, announcement_t::kCommitted, 1, 0, kStart + 4ms));
  hear_own(announcement(0, 9, kHover0, hop, announcement_t::kCommitted, 1, 0, kStart + 4ms));  // said again
  hear_own(announcement(0, 11, hop));
  hear_own(announcement(1, 2, kHover1, flight(kHover1, {1.9, 0, 1}), announcement_t::kCommitted));
  hear_own(announcement(0, 12, kHover0, hop, announcement_t::kCommitted, 2, 0, kStart + 11ms));
  EXPECT_EQ(audit.delays_ms(), (std::vector<double>{3.0, 2.0, 1.0}));
  audit.hear(announcement(0, 20, kHover0, hop, announcement_t::kCommitted, 3));
  audit.hear_own(Bytes{1, 2, 3});
  EXPECT_EQ(audit.delays_ms().size(), 3u);
}

// Forced ones are conflicts like others, and said to be forced, also once they are flown.
TEST(CommitAudit, WhatWasForcedIsTold) {
  CommitAudit audit;
  const Trajectory hop = flight(kHover1, {0.3, 0, 1});
  audit.hear(announcement(1, 0, kHover1));
  audit.hear(announcement(1, 1, kHover1, hop, announcement_t::kCommitted, 1, 2));
  audit.hear(announcement(1, 2, hop, {}, announcement_t::kNone, 1, 2));
  EXPECT_EQ(audit.motions(), 2);
  EXPECT_EQ(audit.forced(), 1);
  audit.hear(announcement(0, 0, kHover0));
  ASSERT_EQ(audit.conflicts().size(), 1u);
  EXPECT_TRUE(audit.conflicts()[0].forced);
  audit.hear(announcement(0, 6'000, Trajectory::hover(2, kStart, {0.1, 0, 1})));
  ASSERT_EQ(audit.conflicts().size(), 2u);
  EXPECT_FALSE(audit.conflicts()[1].forced);  // long after: that is no excuse
  audit.hear(announcement(1, 0, hop, {}, announcement_t::kNone, 2, 2));
  EXPECT_EQ(audit.forced(), 1);  // kept over a restart, not forced again
}

// Where clocks differ, motions are compared at the same moments.
TEST(CommitAudit, TimesAreSetBackByTheClocksOffset) {
  for (const Duration offset : {0ms, 400ms}) {
    CommitAudit audit;  // one after the other through the same place; by the second's clock, at once
    const Trajectory first = flight(Trajectory::hover(1, kStart, {-2, 0, 1}), {2, 0, 1});
    Trajectory second = flight(Trajectory::hover(1, kStart, {0, -2, 1}), {0, 2, 1});
    second.shift(400ms);
    audit.hear(announcement(0, 0, first));
    audit.hear(announcement(1, 0, second), offset);
    EXPECT_EQ(audit.conflicts().size(), offset == 0ms ? 0u : 1u);
  }
}

// A clock that is set in flight moves a robot's stamps, not its motion; one that it was given is known more exactly.
TEST(CommitAudit, ClocksThatAreSetAreMeasured) {
  const Trajectory first = flight(Trajectory::hover(1, kStart, {-2, 0, 1}), {2, 0, 1});
  const Trajectory later = flight(Trajectory::hover(1, kStart, {0, -2, 1}), {0, 2, 1});
  const auto conflicts = [&](Duration apart, Duration set, std::optional<Duration> sent) {
    CommitAudit audit;
    Trajectory second = later;
    second.shift(apart + set);
    announcement_t message{};
    if (decode_packed(announcement(1, 0, second), &message) != Refusal::kNone)
      throw std::runtime_error("not an announcement");
    message.header.utime += set.count();
    audit.collect(announcement(0, 0, first), sent ? std::optional(kStart) : std::nullopt);
    audit.collect(packed(message), sent ? std::optional(kStart + *sent) : std::nullopt);
    audit.finish();
    return audit.conflicts().size();
  };
  EXPECT_EQ(conflicts(0ms, 0ms, 0ms), 1u);
  EXPECT_EQ(conflicts(400ms, 0ms, 0ms), 0u);
  EXPECT_EQ(conflicts(0ms, -3s, 0ms), 1u);
  EXPECT_EQ(conflicts(400ms, -400ms, 0ms), 0u);
  EXPECT_EQ(conflicts(400ms, -400ms, {}), 1u);  // nobody measured
  EXPECT_EQ(conflicts(0ms, 0ms, 15ms), 1u);     // a packet that took its time
}

TEST(CommitAudit, ALogOfAFlightOverABadLinkIsClean) {
  const TemporaryDirectory directory;
  const World world = make_world(Task::kCircle, Environment::kEmpty, 0, 3, {.robots = 4, .circle_m = 2.5});
  FlightOptions options;
  options.link.delay_ms = 100;
  options.link.jitter_ms = 50;
  options.link.loss = 0.3;
  BusLog logs(directory.path(), {0, 1, 2, 3});
  const RunReport report = run_lockstep(world, nullptr, options, {}, &logs, nullptr, nullptr);
  logs.close();
  EXPECT_EQ(report.outcome, Outcome::kSuccess) << summary_table(report);
  EXPECT_EQ(report.commit_conflicts, 0);
  const CommitAudit audit = audit_log(directory.path() / "swarm.lcm");
  EXPECT_EQ(audit.robots(), 4);
  EXPECT_GT(audit.motions(), 20);
  EXPECT_TRUE(audit.conflicts().empty());

  const auto audited = [&](const std::string& log) {
    return run_program({"swarm_sim", "audit", (directory.path() / log).string()});
  };
  const Finished clean = audited("swarm.lcm");
  EXPECT_EQ(clean.exit_code, 0) << clean.err;
  EXPECT_NE(
      clean.out.find("4 robots, " + std::to_string(audit.motions()) + " committed motions (0 forced), 0 conflicts"),
      std::string::npos)
      << clean.out;
  EXPECT_EQ(audited("robot0.lcm").exit_code, 2);  // no announcements
  EXPECT_EQ(audited("none.lcm").exit_code, 2);
  EXPECT_EQ(run_program({"swarm_sim", "audit", "--none"}).exit_code, 2);
}

TEST(CommitAudit, ConflictsInALogAreNamed) {
  const TemporaryDirectory directory;
  BusLog logs(directory.path(), {0, 1});
  logs.write(BusId::kSwarm, 0, kStart, channel::kAnnouncement, announcement(0, 0, kHover0));
  logs.write(BusId::kSwarm, 0, kStart, channel::kAnnouncement, announcement(1, 1, flight(kHover1, {0.3, 0, 1})));
  logs.close();
  const Finished found = run_program({"swarm_sim", "audit", (directory.path() / "swarm.lcm").string()});
  EXPECT_EQ(found.exit_code, 1);
  EXPECT_NE(found.out.find("robot 1 (trajectory 2) and robot 0 (trajectory 1)"), std::string::npos) << found.out;
}

// A flight that goes on and on is audited on its way.
TEST(CommitAudit, LongFlightsAreAuditedToo) {
  constexpr int kCommits = 60'000;  // of each robot; 100,000 of all are kept
  CommitAudit audit;
  for (int i = 0; i < kCommits; ++i) {
    const Utime utime = kStart + i * 100ms;
    const bool meets = i == 10 || i == kCommits - 10;
    audit.collect(announcement(0, i, Trajectory::hover(i + 1, utime, {0, 0, 1})));
    audit.collect(announcement(1, i, Trajectory::hover(i + 1, utime, {meets ? 0.1 : 10.0, 0, 1})));
  }
  audit.finish();
  EXPECT_EQ(audit.motions(), 2 * kCommits);
  EXPECT_EQ(audit.conflicts().size(), 4u);
}

}  // namespace
}  // namespace swarm::test
