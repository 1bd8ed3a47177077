#include "tools/viewer/log_player.h"

#include <random>
#include <thread>

#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/results/recorder.h"
#include "swarm_sim/world/world_generator.h"
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

class Logs : public testing::Test {
 protected:
  Logs() {
    const World world = make_world(Task::kCircle, Environment::kPure, 6, 1, {.robots = 2, .circle_m = 2.5});
    BusLog logs(directory_.path(), {0, 1});
    FlightOptions options;
    options.time_limit_s = 3.0;
    run_lockstep(world, nullptr, options, {}, &logs, nullptr, nullptr);
    logs.close();
  }
  std::vector<std::string> paths() const {
    return {directory_ / "robot0.lcm", directory_ / "robot1.lcm", directory_ / "swarm.lcm"};
  }

  TemporaryDirectory directory_;
};

// What a browser would be shown of it.
std::string shown(const PictureSource::Moment& moment) {
  FrameWriter writer;
  Json all = {to_us(moment.utime), robots_json(moment.picture, moment.utime, &writer),
              obstacles_json(moment.picture, moment.utime, -1)};
  for (Json& robot : all[1]) {
    for (const auto& [id, picture] : moment.picture.robots()) {
      if (robot["id"] == id && picture.sogm.count() > 0) robot["sogm"] = sogm_json(picture.sogm.newest(), -1, &writer);
      if (robot["id"] == id) robot["corridors"] = corridors_json(picture, &writer);
    }
    for (auto& traffic : robot["traffic"]) traffic.erase("heard"), traffic.erase("missing");  // since it was opened
  }
  std::vector<std::uint8_t> bytes;
  writer.finish(all, &bytes);
  return {bytes.begin(), bytes.end()};
}

TEST_F(Logs, IndexHoldsEverythingInOrderOfTime) {
  const LogIndex index(paths());
  std::size_t events = 0;
  for (const std::string& path : paths()) {
    LcmLog log(path);
    for (LogEvent event; log.next(&event);) ++events;
  }
  EXPECT_EQ(index.entries().size(), events);
  EXPECT_GT(events, 1000u);
  EXPECT_TRUE(std::is_sorted(index.entries().begin(), index.entries().end(),
                             [](const auto& a, const auto& b) { return a.utime < b.utime; }));
  EXPECT_EQ(index.skipped(), 0);
  EXPECT_NEAR(to_seconds(index.length()), 3.0, 0.1);
}

TEST_F(Logs, AnyTimeLooksTheSameFromWhereverOneComes) {
  const LogIndex index(paths());
  LogPlayer jumping(index);
  jumping.control({{"play", false}});
  std::mt19937 random(1);
  const double length_s = to_seconds(index.length());
  for (int i = 0; i < 30; ++i) {
    const double at_s = std::uniform_real_distribution<double>(0.0, length_s)(random);
    jumping.control({{"seek", at_s}});
    // From the beginning on, in steps that are played through.
    LogPlayer steady(index);
    steady.control({{"play", false}});
    const int robot = i % 3 - 1;  // whose map is looked at
    if (i % 2 == 0) steady.select(robot);
    for (double t_s = 0.0; t_s < at_s; t_s += 0.9) steady.control({{"seek", t_s}}), (void)steady.now();
    steady.control({{"seek", at_s}});
    steady.select(robot);
    jumping.select(robot);
    const std::string seen = shown(jumping.now());
    ASSERT_EQ(seen, shown(steady.now())) << at_s << " s";
    const bool has_map = seen.find("num_frames") != seen.npos;
    if (robot < 0 || at_s > 0.5) {
      EXPECT_EQ(has_map, robot >= 0) << at_s << " s";
    }
  }
}

TEST_F(Logs, PlaysToTheEndAndAgain) {
  const LogIndex index(paths());
  LogPlayer player(index);
  const auto at_s = [&] { return (void)player.now(), player.describe()["at_s"].get<double>(); };
  EXPECT_TRUE(wait_for(5.0, [&] { return at_s() > 0.3; }));
  player.control({{"play", false}});
  const double paused_s = at_s();
  std::this_thread::sleep_for(50ms);
  EXPECT_EQ(at_s(), paused_s);
  EXPECT_LT(paused_s, 3.0);
  player.control({{"speed", 20.0}, {"play", true}});
  const double length_s = player.describe()["length_s"];
  EXPECT_TRUE(wait_for(5.0, [&] { return at_s() == length_s; }));
  EXPECT_EQ(player.describe()["playing"], false);
  player.control({{"speed", 0.1}});
  player.control({{"play", true}});
  EXPECT_LT(at_s(), 0.5 * length_s) << "from the beginning again";
}

TEST_F(Logs, RefusesWhatCannotBe) {
  const LogIndex index(paths());
  LogPlayer player(index);
  player.control({{"play", false}, {"seek", 1.0}});
  for (const Json& bad :
       {Json{{"seek", -0.1}}, Json{{"seek", 1e9}}, Json{{"seek", "x"}}, Json{{"speed", 0.0}}, Json{{"speed", 1000}},
        Json{{"speed", nullptr}}, Json{{"play", 1}}, Json{{"goal", {{"robot", 0}}}}}) {
    EXPECT_ANY_THROW(player.control(bad)) << bad;
    EXPECT_EQ((player.now(), player.describe()["at_s"]), 1.0) << bad;
  }
  EXPECT_THROW(LogIndex({"/no/log"}), std::runtime_error);
  EXPECT_THROW(LogIndex({write_text(directory_ / "empty.lcm", "")}), std::runtime_error);
}

}  // namespace
}  // namespace swarm::test
