// The radio between robots: shares, delays and outages as they were asked for, and flights over it.
#include "swarm_sim/hosts/link_model.h"

#include <gtest/gtest.h>

#include "lcmtypes/bus/option_set.h"
#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/world/world_generator.h"

namespace swarm {
namespace {

constexpr int kDatagrams = 20'000;

std::vector<std::vector<Duration>> sent(const LinkOptions& options, std::uint64_t seed = 1) {
  LinkModel link(options, seed);
  std::vector<std::vector<Duration>> all;
  for (int i = 0; i < kDatagrams; ++i) {
    const auto delays = link.deliveries(0, 1, 0.001 * i);
    all.emplace_back(delays.begin(), delays.end());
  }
  return all;
}

double share(const std::vector<std::vector<Duration>>& all,
             const std::function<bool(const std::vector<Duration>&)>& of) {
  return static_cast<double>(std::count_if(all.begin(), all.end(), of)) / kDatagrams;
}

TEST(LinkModel, APerfectLinkDeliversAtOnce) {
  EXPECT_TRUE(LinkOptions().perfect());
  for (const auto& delays : sent({})) ASSERT_EQ(delays, std::vector<Duration>{0us});
}

TEST(LinkModel, LosesDoublesAndHoldsBackTheSharesAskedFor) {
  LinkOptions options;
  options.loss = 0.3;
  options.duplicate = 0.2;
  const auto all = sent(options);
  EXPECT_FALSE(options.perfect());
  EXPECT_NEAR(share(all, [](const auto& delays) { return delays.empty(); }), 0.3, 0.02);
  EXPECT_NEAR(share(all, [](const auto& delays) { return delays.size() == 2; }), 0.7 * 0.2, 0.02);

  LinkOptions held;
  held.reorder = 0.1;
  EXPECT_NEAR(share(sent(held), [](const auto& delays) { return delays.at(0) > 0us; }), 0.1, 0.01);
  for (const auto& delays : sent(held)) ASSERT_LE(to_ms(delays.at(0)), LinkOptions::kHeldBack_ms);
}

TEST(LinkModel, DelaysAreUniformWithinTheJitter) {
  LinkOptions options;
  options.delay_ms = 100;
  options.jitter_ms = 50;
  double mean_ms = 0.0;
  Duration least = Duration::max(), most{};
  for (const auto& delays : sent(options)) {
    ASSERT_EQ(delays.size(), 1u);
    mean_ms += to_ms(delays[0]) / kDatagrams;
    least = std::min(least, delays[0]);
    most = std::max(most, delays[0]);
  }
  EXPECT_NEAR(mean_ms, 100.0, 1.0);
  EXPECT_GE(least, 50ms);
  EXPECT_LT(least, 50'500us);
  EXPECT_LE(most, 150ms);
  EXPECT_GT(most, 149'500us);

  options.delay_ms = 10;  // none arrives before it was sent
  for (const auto& delays : sent(options)) ASSERT_GE(delays.at(0), 0us);
}

TEST(LinkModel, InAnOutageARobotNeitherSendsNorReceives) {
  LinkOptions options;
  options.outages = parse_outages("1:2:3.5,2:0:1");
  LinkModel link(options, 1);
  EXPECT_EQ(link.deliveries(0, 1, 1.99).size(), 1u);
  EXPECT_TRUE(link.deliveries(0, 1, 2.0).empty());
  EXPECT_TRUE(link.deliveries(1, 0, 3.49).empty());
  EXPECT_EQ(link.deliveries(1, 0, 3.5).size(), 1u);
  EXPECT_EQ(link.deliveries(0, 3, 2.5).size(), 1u);
  EXPECT_TRUE(link.deliveries(3, 2, 0.5).empty());
}

TEST(LinkModel, TheSeedDecides) {
  LinkOptions options;
  options.loss = 0.5;
  options.jitter_ms = 5;
  EXPECT_EQ(sent(options, 1), sent(options, 1));
  EXPECT_NE(sent(options, 1), sent(options, 2));
}

TEST(LinkModel, OutagesThatMakeNoSenseAreRefused) {
  EXPECT_TRUE(parse_outages("").empty());
  for (const char* text : {"1", "1:2", "1:2:3:4", "a:2:3", "-1:2:3", "1:3:2", "1:2:2", "1:2:x", "1:2:3,", "1:nan:3",
                           "1:2:inf", "1: 2:3"}) {
    SCOPED_TRACE(text);
    EXPECT_THROW((void)parse_outages(text), OptionError);
  }
}

// Messages that are lost, doubled, late and out of order cost time, never safety.
TEST(LinkModel, FlightsOverABadLinkDoNotTouch) {
  const World world = make_world(Task::kCircle, Environment::kEmpty, 0, 3, {.robots = 4, .circle_m = 2.5});
  FlightOptions perfect, bad;
  perfect.time_limit_s = bad.time_limit_s = 12.0;
  bad.link.delay_ms = 8;
  bad.link.jitter_ms = 8;
  bad.link.loss = 0.3;
  bad.link.duplicate = 0.2;
  bad.link.reorder = 0.1;
  bad.link.outages = {{1, 1.0, 2.0}};
  const RunReport good = run_lockstep(world, nullptr, perfect, {}, nullptr, nullptr, nullptr);
  const RunReport report = run_lockstep(world, nullptr, bad, {}, nullptr, nullptr, nullptr);
  EXPECT_TRUE(report.touches.empty()) << summary_table(report);
  EXPECT_EQ(good.outcome, Outcome::kSuccess) << summary_table(good);
  EXPECT_EQ(report.outcome, Outcome::kSuccess) << summary_table(report);
  EXPECT_EQ(report.commit_conflicts, 0);
  EXPECT_GT(report.duration_s, good.duration_s);
  for (const RobotReport& robot : report.robots) EXPECT_LT(robot.verdict.to_robots.distance_m, 4.0);  // they did fly
}

// Clocks that differ by less than is allowed for cost nothing; beyond, as soon as that is known, everybody rests.
TEST(LinkModel, ClocksMayDifferUpToTheLimit) {
  const World world = make_world(Task::kCircle, Environment::kEmpty, 0, 3, {.robots = 4, .circle_m = 2.5});
  for (const double offset_ms : {9.0, 11.5}) {
    SCOPED_TRACE(offset_ms);
    FlightOptions options;
    options.time_limit_s = offset_ms < 10.0 ? 12.0 : 20.0;
    options.link.delay_ms = 3;
    options.clock_offset_ms = offset_ms;
    const RunReport report = run_lockstep(world, nullptr, options, {}, nullptr, nullptr, nullptr);
    EXPECT_TRUE(report.touches.empty()) << summary_table(report);
    EXPECT_EQ(report.commit_conflicts, 0);
    EXPECT_EQ(report.outcome == Outcome::kSuccess, offset_ms < 10.0) << summary_table(report);
  }
}

}  // namespace
}  // namespace swarm
