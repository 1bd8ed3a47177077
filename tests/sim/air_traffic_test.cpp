// What crosses the air: how long frames take a channel, and what a flight's report says of it.
#include "swarm_sim/results/air_traffic.h"

#include <gtest/gtest.h>

#include "lcmtypes/bus/channels.h"
#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/world/world_generator.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

// By hand: a datagram of 200 bytes is a frame of 28 + 8 + 20 + 200 = 256 bytes, and so 16 + 8 * 256 + 6 = 2,070 bits:
// 86.25 symbols of 24 bits, 21.6 of 96, 9.6 of 216.
TEST(Airtime, OfAFrameAsTheStandardHasIt) {
  EXPECT_EQ(frame_duration(200, 6), 20us + 87 * 4us);
  EXPECT_EQ(frame_duration(200, 24), 20us + 22 * 4us);
  EXPECT_EQ(frame_duration(200, 54), 20us + 10 * 4us);
  EXPECT_DOUBLE_EQ(frame_airtime_us(200, 6), 34 + 7.5 * 9 + 368);
  EXPECT_DOUBLE_EQ(frame_airtime_us(200, 24), 34 + 7.5 * 9 + 108);
  EXPECT_EQ(frame_duration(4, 6), 20us + 21 * 4us);  // 502 bits, 504 fit
  EXPECT_EQ(frame_duration(5, 6), 20us + 22 * 4us);
}

TEST(Airtime, ADatagramHoldsHeadChannelMessageAndSeal) {
  EXPECT_EQ(datagram_bytes("ANNOUNCEMENT", 100), 8u + 8u + 13u + 100u + 20u);
  EXPECT_EQ(datagram_bytes("A", 0), 8u + 8u + 2u + 20u);
}

Bytes announcement_of(int robot, std::size_t packed_bytes) {
  sogm_swarm::packed_announcement_t message{};
  message.header = make_header(robot, 1, 1, kStart);
  message.num_bytes = static_cast<std::int16_t>(packed_bytes);
  message.packed.resize(packed_bytes);
  return encoded(message);
}

TEST(AirTraffic, CountsBySecondsOfTheFlight) {
  RunReport report;
  report.duration_s = 2.5;
  report.robots.resize(3);
  for (const std::size_t i : {0u, 1u, 2u}) report.robots[i].verdict.id = 10 * static_cast<int>(i);
  const Bytes small = announcement_of(0, 50), large = announcement_of(20, 200);
  AirTraffic traffic;
  traffic.send(-0.1, channel::kAnnouncement, small);  // before the flight
  traffic.send(0.5, channel::kAnnouncement, Bytes{1, 2, 3});
  traffic.finish(&report);
  EXPECT_EQ(report.air.datagrams, 0);
  EXPECT_EQ(report.air.airtime[0].busiest_second, 0.0);
  EXPECT_FALSE(std::isfinite(report.robots[0].received_hz));

  for (const double t_s : {0.0, 1.1, 1.2, 1.999, 2.0}) traffic.send(t_s, channel::kAnnouncement, small);
  for (const double t_s : {0.5, 2.4}) traffic.send(t_s, channel::kAnnouncement, large);
  traffic.receive(10, 2);
  traffic.receive(10, 3);
  traffic.finish(&report);
  const std::size_t small_size = datagram_bytes(channel::kAnnouncement, small.size()), large_size = small_size + 150;
  EXPECT_EQ(report.air.datagrams, 7);
  EXPECT_DOUBLE_EQ(report.air.datagram_bytes, static_cast<double>(small_size) + 2 * 150.0 / 7);
  EXPECT_DOUBLE_EQ(report.robots[0].sent_hz, 2.0);
  EXPECT_DOUBLE_EQ(report.robots[2].sent_hz, 0.8);
  EXPECT_DOUBLE_EQ(report.robots[1].received_hz, 2.0);
  EXPECT_EQ(report.robots[0].received_hz, 0.0);
  EXPECT_EQ(report.robots[0].datagram_bytes, static_cast<double>(small_size));
  EXPECT_EQ(report.robots[1].datagram_bytes, 0.0);
  for (const std::size_t i : {0u, 1u}) {
    const double small_us = frame_airtime_us(small_size, kAirRates_mbps[i]);
    const double large_us = frame_airtime_us(large_size, kAirRates_mbps[i]);
    EXPECT_NEAR(report.air.airtime[i].mean, 1e-6 * (5 * small_us + 2 * large_us) / 2.5, 1e-12);
    EXPECT_NEAR(report.air.airtime[i].busiest_second, 3e-6 * small_us, 1e-12);
  }
}

// Whatever is sent arrives at all others, or as much less as the link loses.
TEST(AirTraffic, OfAFlightAddsUp) {
  const World world = make_world(Task::kCircle, Environment::kEmpty, 0, 3, {.robots = 4, .circle_m = 2.5});
  for (const double loss : {0.0, 0.3}) {
    SCOPED_TRACE(loss);
    FlightOptions options;
    options.link.loss = loss;
    const RunReport report = run_lockstep(world, nullptr, options, {}, nullptr, nullptr, nullptr);
    double sent_hz = 0.0, received_hz = 0.0;
    for (const RobotReport& robot : report.robots) {
      sent_hz += robot.sent_hz;
      received_hz += robot.received_hz;
      EXPECT_GT(robot.sent_hz, 10.0);  // as at rest, at least
      EXPECT_LT(robot.sent_hz, 250.0);
      EXPECT_GT(robot.datagram_bytes, 100.0);
      EXPECT_LT(robot.datagram_bytes, 300.0);
    }
    EXPECT_NEAR(received_hz, (1 - loss) * 3 * sent_hz, loss == 0.0 ? 1e-6 : 0.03 * sent_hz);
    EXPECT_NEAR(static_cast<double>(report.air.datagrams), sent_hz * report.duration_s, 1e-6);
    EXPECT_EQ(report.air.datagrams, report.channels.at(channel::kAnnouncement).messages);
    EXPECT_NEAR(report.air.airtime[0].mean, 1e-6 * sent_hz * frame_airtime_us(180, 6), 0.03);
    EXPECT_GE(report.air.airtime[0].busiest_second, report.air.airtime[0].mean);
    EXPECT_GT(report.commit.count, 30);
    EXPECT_GE(report.commit.p99_ms, loss == 0.0 ? 4.0 : 10.0);  // there and back, or said again
    EXPECT_LT(report.commit.p99_ms, 300.0);
  }
}

}  // namespace
}  // namespace swarm::test
