// The view as a program: its page, its stream, and what a real browser shows of a real flight.
#include <octomap/OcTree.h>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/realtime_host.h"
#include "swarm_sim/world/world_generator.h"
#include "swarm_sim/world/world_json.h"
#include "tests/support/view_program.h"
#include "tests/support/web_browser.h"

namespace swarm::test {
namespace {

using boost::beast::http::verb;

TEST(View, ServesItsPageAndNothingElse) {
  View view({});
  EXPECT_NE(web_request(view.port(), "/").body.find("<title>Swarm view</title>"), std::string::npos);
  EXPECT_NE(web_request(view.port(), "/view.js").body.find("function connect"), std::string::npos);
  EXPECT_NE(web_request(view.port(), "/scene.js?again").body.find("class SwarmScene"), std::string::npos);
  for (const char* script : {"labels", "plots", "mission", "keys"})
    EXPECT_EQ(web_request(view.port(), "/" + std::string(script) + ".js").status, 200) << script;
  EXPECT_EQ(web_request(view.port(), "/three.js").body, "// build/three.min");
  EXPECT_EQ(web_request(view.port(), "/../../etc/passwd").status, 404);
  EXPECT_EQ(web_request(view.port(), "/", "localhost", verb::post).status, 405);
  EXPECT_EQ(web_request(view.port(), "/", "127.0.0.1:1").status, 200);
  EXPECT_EQ(web_request(view.port(), "/", "[::1]:8080").status, 200);
  EXPECT_EQ(web_request(view.port(), "/", "localhost").status, 200);
  // Names that anybody can make point here, and what is none.
  for (const char* host :
       {"evil.example", "evil.example:80", "[evil.example]", "[evil.example]:80", "[localhost]", "[::1",
        "[::1]evil.example", "[127.0.0.1]", "localhost:", "localhost:80:80", "localhost:x", "::1", ""})
    EXPECT_EQ(web_request(view.port(), "/", host).status, 403) << host;
}

TEST(View, StreamsToItsOwnPageOnly) {
  View view({});
  const std::string port = std::to_string(view.port());
  EXPECT_NO_THROW(WebSocket(view.port(), "/stream", "http://localhost:" + port, "localhost:" + port).receive());
  EXPECT_ANY_THROW(WebSocket(view.port(), "/stream", "http://evil.example", "localhost:" + port));
  EXPECT_ANY_THROW(WebSocket(view.port(), "/stream", "http://evil.example", "evil.example"));
  EXPECT_ANY_THROW(WebSocket(view.port(), "/stream", "", "localhost:" + port));
  EXPECT_ANY_THROW(WebSocket(view.port(), "/other", "http://localhost:" + port, "localhost:" + port));
  EXPECT_EQ(web_request(view.port(), "/stream").status, 403);
}

TEST(View, ShowsWhatTheBusesSayAndThatTheyAreSilent) {
  View view({"--onboard", "0,1"});
  Watcher watcher(view.port());
  const ViewFrame silent = watcher.next();
  EXPECT_EQ(silent.text["mode"], "live");
  EXPECT_EQ(silent.text["messages"], 0);
  EXPECT_EQ(silent.text["buses"].size(), 3u);
  EXPECT_EQ(silent.text["robots"].size(), 0u);

  LcmBus first(onboard_url(0)), second(onboard_url(1));
  std::int64_t seq = 0;
  const auto frame = watcher.until([&](const ViewFrame&) {
    publish_hover(first, 0, {1.0, 2.0, 3.0}, ++seq);
    publish_hover(second, 1, {-1.5, 0.25, 1.125}, seq);
    EXPECT_TRUE(first.publish(channel::kRobotState, Bytes(92, 7)));
    return seq == 60;
  });
  ASSERT_TRUE(frame);
  ASSERT_EQ(frame->text["robots"].size(), 2u);
  EXPECT_EQ((*frame->robot(0))["position"], WebJson({1.0, 2.0, 3.0}));
  EXPECT_EQ((*frame->robot(1))["position"], WebJson({-1.5, 0.25, 1.125}));
  EXPECT_EQ((*frame->robot(1))["radius"], 0.25);
  const std::vector<float> points = frame->numbers<float>((*frame->robot(1))["committed"]["points"]);
  ASSERT_GE(points.size(), 6u);
  EXPECT_EQ(points.back(), 1.125f);
  EXPECT_GT((*frame->robot(1))["traffic"]["ROBOT_STATE"]["rate_hz"], 10.0);
  EXPECT_GT(frame->text["refused"], 40) << "damaged messages are counted";
  EXPECT_FALSE(frame->text.contains("warning"));
}

TEST(View, LaptopBesideTheRobotsShowsWhatTheyAnnounce) {
  View view({"--onboard", ""});
  Watcher watcher(view.port());
  EXPECT_EQ(watcher.next().text["buses"].size(), 1u);
  LcmBus swarm_bus("udpm://239.255.76.68:" + std::to_string(base_port()) + "?ttl=0");
  sogm_swarm::announcement_t announcement{};
  announcement.radius = 0.2f;
  announcement.least_delay_us = sogm_swarm::announcement_t::kUnknown;
  std::int64_t seq = 0;
  const auto frame = watcher.until([&](const ViewFrame& seen) {
    announcement.header = make_header(5, 1, ++seq, wall_utime());
    announcement.committed = Trajectory::hover(1, wall_utime(), {3.0, -4.0, 1.5}).to_wire();
    EXPECT_TRUE(swarm_bus.publish(channel::kAnnouncement, packed(announcement)));
    return seen.robot(5) != nullptr;
  });
  ASSERT_TRUE(frame);
  EXPECT_EQ((*frame->robot(5))["position"], WebJson({3.0, -4.0, 1.5}));
}

TEST(View, SendsTheStaticMapOnceAndMapsWhenTheyChange) {
  TemporaryDirectory out;
  fly(out.path());
  octomap::OcTree tree(0.5);
  for (const double x : {0.25, 2.25, 4.25})
    tree.updateNode(octomap::point3d(static_cast<float>(x), 0.25f, 0.25f), true);
  ASSERT_TRUE(tree.writeBinary(out / "walls.bt"));
  View view({out / "robot0.lcm", out / "robot1.lcm", out / "swarm.lcm", "--static-map", out / "walls.bt"});
  Watcher watcher(view.port());
  const ViewFrame first = watcher.next();
  ASSERT_TRUE(first.text.contains("static_map"));
  const std::vector<float> cubes = first.numbers<float>(first.text["static_map"]["cubes"]);
  ASSERT_EQ(cubes.size(), 12u);
  EXPECT_EQ(cubes[3], 0.5f);
  EXPECT_FALSE(first.text.contains("sogm")) << "nobody was chosen";
  watcher.tell(R"({"select": 1, "seek": 1.5, "play": false})");
  const auto with_map = watcher.until([](const ViewFrame& frame) { return frame.text.contains("sogm"); });
  ASSERT_TRUE(with_map);
  EXPECT_FALSE(with_map->text.contains("static_map"));
  EXPECT_EQ(with_map->text["sogm"]["num_frames"], 20);
  const auto voxels = with_map->numbers<std::int16_t>(with_map->text["sogm"]["voxels"]);
  ASSERT_GT(voxels.size(), 400u);
  ASSERT_EQ(voxels.size() % 4, 0u);
  for (std::size_t i = 0; i < voxels.size(); ++i) {
    ASSERT_GE(voxels[i], 0);
    ASSERT_LT(voxels[i], i % 4 == 3 ? 20 : with_map->text["sogm"]["size"][i % 4].get<int>());
  }
  EXPECT_TRUE(with_map->text.contains("corridors"));
  EXPECT_FALSE(watcher.next().text.contains("sogm")) << "it has not changed";
  watcher.tell(R"({"frame": 3})");
  const auto one_frame = watcher.until([](const ViewFrame& frame) { return frame.text.contains("sogm"); });
  ASSERT_TRUE(one_frame);
  const auto fewer = one_frame->numbers<std::int16_t>(one_frame->text["sogm"]["voxels"]);
  EXPECT_LT(fewer.size(), voxels.size());
  for (std::size_t i = 3; i < fewer.size(); i += 4) ASSERT_EQ(fewer[i], 3);
}

TEST(View, SaysThatAReplayedLogNeedsItsOwnTime) {
  for (const bool replay : {false, true}) {
    View view({"--onboard", "0", "--replay", replay ? "true" : "false"});
    Watcher watcher(view.port());
    LcmBus bus(onboard_url(0));
    std::int64_t seq = 0;
    const auto frame = watcher.until([&](const ViewFrame& seen) {
      const Utime utime = kStart + ++seq * 33ms;
      EXPECT_TRUE(bus.publish(channel::kRobotState, encoded(state_at(0, {1, 0, 1}, seq, utime))));
      return seq > 30 && seen.text["messages"] > 10;
    });
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->text.contains("warning"), !replay) << frame->text.value("warning", "");
    if (replay) {
      EXPECT_NEAR(to_seconds(to_utime(frame->text["utime"].get<std::int64_t>()) - kStart), 1.0, 3.0 * kPatience);
    }
  }
}

TEST(View, SendsGoalsOnlyWhenAllowed) {
  for (const bool allowed : {false, true}) {
    View view({"--onboard", "0", "--allow-goals", allowed ? "true" : "false"});
    Watcher watcher(view.port());
    LcmBus bus(onboard_url(0));
    std::vector<sogm_swarm::goal_t> goals;
    bus.subscribe(channel::kGoal, [&](std::string_view, std::span<const std::uint8_t> bytes) {
      EXPECT_EQ(decode(bytes, &goals.emplace_back()), Refusal::kNone);
    });
    EXPECT_EQ(watcher.next().text["allow_goals"], allowed);
    watcher.tell(
        R"({"goal": {"robot": 0, "waypoints": [{"position": [1.5, -2, 1]}, {"position": [1, 2, 3], "wait_s": 4}],
                      "times": 2}})");
    const auto answer = watcher.until([&](const ViewFrame& frame) {
      bus.drain();
      return allowed ? !goals.empty() : frame.text.contains("error");
    });
    ASSERT_TRUE(answer);
    if (!allowed) {
      EXPECT_EQ(answer->text["error"]["text"], "goals are not allowed: start with --allow-goals true");
      EXPECT_TRUE(goals.empty());
      continue;
    }
    EXPECT_EQ(goals[0].header.robot_id, 0);
    EXPECT_EQ(goals[0].waypoints[0].position[0], 1.5);
    EXPECT_EQ(goals[0].waypoints[0].position[1], -2.0);
    ASSERT_EQ(goals[0].num_waypoints, 4);
    EXPECT_EQ(goals[0].waypoints[3].position[2], 3.0);
    EXPECT_EQ(goals[0].waypoints[3].wait, 4.0);
    int errors = 0;
    for (const char* bad : {R"({"order": {"robots": [0], "name": "jump"}})",
                            R"({"order": {"robots": [0], "name": "take-off", "height": 0}})",
                            R"({"order": {"robots": [7], "name": "land"}})", R"({"order": {"name": "land"}})",
                            R"({"goal": {"robot": 7, "waypoints": [{"position": [0, 0, 1]}]}})",
                            R"({"goal": {"robot": 0, "waypoints": [{"position": [0, 0, 1e9]}]}})",
                            R"({"goal": {"robot": 0, "waypoints": []}})", R"({"goal": 3})", R"({"play": true})", "[]",
                            "{", R"({"select": "me"})", R"({"frame": null})"}) {
      watcher.tell(bad);
      const auto refused = watcher.until([&](const ViewFrame& frame) {
        return frame.text.contains("error") && frame.text["error"]["number"] > errors;
      });
      ASSERT_TRUE(refused) << bad;
      EXPECT_EQ(refused->text["error"]["number"], ++errors) << bad;
    }
  }
}

// Whoever sent it: the daemons take only what is newer than what they have.
TEST(View, ItsGoalsAndOrdersAreNewerThanThoseBefore) {
  View view({"--onboard", "0", "--allow-goals", "true"});
  Watcher watcher(view.port());
  LcmBus bus(onboard_url(0));
  SequenceGate order_gate, goal_gate;
  std::int16_t order = 0;
  double x = 0.0;
  bus.subscribe(channel::kFlightOrder, [&](std::string_view, std::span<const std::uint8_t> bytes) {
    sogm_swarm::order_t message;
    ASSERT_EQ(decode(bytes, &message), Refusal::kNone);
    if (order_gate.pass(message.header) == Refusal::kNone) order = message.order;
  });
  bus.subscribe(channel::kGoal, [&](std::string_view, std::span<const std::uint8_t> bytes) {
    sogm_swarm::goal_t message;
    ASSERT_EQ(decode(bytes, &message), Refusal::kNone);
    if (goal_gate.pass(message.header) == Refusal::kNone) x = message.waypoints[0].position[0];
  });
  const auto comes = [&](std::int16_t wanted_order, double wanted_x) {
    return wait_for(10.0 * kPatience, [&] {
      bus.drain();
      return order == wanted_order && x == wanted_x;
    });
  };
  const auto by_tool = [&](std::vector<std::string> words) {
    words.insert(words.begin(), {"swarm_goal", "--base-port", std::to_string(base_port()), "--patience", "0.5"});
    EXPECT_EQ(run_program(words).exit_code, 1) << "nobody answers";
  };
  watcher.tell(R"({"goal": {"robot": 0, "waypoints": [{"position": [1, 0, 1]}]}})");
  EXPECT_TRUE(comes(sogm_swarm::order_t::kFly, 1.0));
  by_tool({"0", "2,0,1"});
  by_tool({"0", "hold"});
  EXPECT_TRUE(comes(sogm_swarm::order_t::kHold, 2.0));
  watcher.tell(R"({"goal": {"robot": 0, "waypoints": [{"position": [3, 0, 1]}]}})");
  EXPECT_TRUE(comes(sogm_swarm::order_t::kFly, 3.0));
  by_tool({"0", "hold"});
  EXPECT_TRUE(comes(sogm_swarm::order_t::kHold, 3.0));
  watcher.tell(R"({"order": {"robots": [0], "name": "emergency"}})");
  EXPECT_TRUE(comes(sogm_swarm::order_t::kEmergency, 3.0));
}

TEST(View, NeitherSlowNorVanishedBrowsersHoldUpTheOthers) {
  TemporaryDirectory out;
  fly(out.path());
  View view({out / "robot0.lcm", out / "robot1.lcm", out / "swarm.lcm"});
  Watcher quick(view.port()), slow(view.port());
  for (Watcher* watcher : {&quick, &slow}) watcher->tell(R"({"select": 0, "frame": -1})");
  for (int i = 0; i < 10; ++i) Watcher(view.port()).drop();
  for (int i = 0; i < 10; ++i) (void)quick.next();
  const std::int64_t before_kb = view.resident_kb();
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < 60; ++i) {
    if (i % 20 == 0) quick.tell(R"({"seek": 0, "play": true})");
    (void)quick.next();
  }
  const double took_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  EXPECT_LT(took_s, 2.0 * 1.5 * kPatience) << "30 frames a second beside one who does not read";
  if (!kSanitized) {  // which keep what is freed
    EXPECT_LT(view.resident_kb() - before_kb, 10'000);
  }
  // What the slow one gets when he reads again is soon what is shown now.
  slow.tell(R"({"seek": 1.25, "play": false})");
  EXPECT_TRUE(slow.until([](const ViewFrame& frame) { return frame.text["at_s"] == 1.25; }));
}

TEST(View, ReportsWhatItCannotDo) {
  TemporaryDirectory directory;
  View view({});
  const std::string port = std::to_string(view.port());
  const auto failure = [&](std::vector<std::string> words) {
    words.insert(words.begin(), "swarm_view");
    words.insert(words.end(), {"--base-port", std::to_string(base_port())});
    const Finished finished = run_program(words);
    EXPECT_EQ(finished.exit_code, 2) << finished.err;
    return finished.err.substr(finished.err.rfind("swarm_view: "));
  };
  const std::string log = write_text(directory / "noise.lcm", std::string(5000, 'x'));
  EXPECT_EQ(failure({log}), "swarm_view: " + log + ": holds no LCM events (5000 bytes)\n");
  EXPECT_EQ(failure({"/no/log"}), "swarm_view: /no/log: must be a readable LCM log\n");
  EXPECT_EQ(failure({"--address", "example.org"}),
            "swarm_view: example.org, port 8080: must be an IP address of this computer\n");
  EXPECT_EQ(failure({"--three", "/no/three"}),
            "swarm_view: /no/three/build/three.min.js: cannot be read; install libjs-three (tools/setup --view) or set "
            "--three\n");
  EXPECT_EQ(failure({"--static-map", "/no/map.bt"}).substr(0, 25), "swarm_view: '/no/map.bt' ");
}

TEST(View, TwoCannotHaveOnePort) {
  View view({});
  const Finished second = run_program(std::vector<std::string>{"swarm_view", "--port", std::to_string(view.port()),
                                                               "--base-port", std::to_string(base_port())});
  if (second.err.find("libjs-three") != std::string::npos) GTEST_SKIP() << "libjs-three is not installed";
  EXPECT_EQ(second.exit_code, 2);
  EXPECT_NE(second.err.find("swarm_view: 127.0.0.1, port " + std::to_string(view.port()) +
                            ": is in use by another program; choose another with --port"),
            std::string::npos)
      << second.err;
}

TEST(View, PlaysADamagedLog) {
  TemporaryDirectory out;
  fly(out.path());
  std::string bytes = read_text(out / "robot0.lcm");
  bytes.replace(bytes.find("\xED\xA1\xDA\x01", bytes.size() / 2), 20, std::string(20, '\0'));
  View view({write_text(out / "damaged.lcm", bytes)});
  Watcher watcher(view.port());
  const auto frame = watcher.until([](const ViewFrame& seen) { return seen.text["at_s"] > 1.5; });
  ASSERT_TRUE(frame);
  EXPECT_GT(frame->text["damaged_bytes"], 0);
  EXPECT_NE(view.program().err().find("bytes of the logs are no events"), std::string::npos);
}

// Where a robot's state said it was.
using Places = std::map<int, std::vector<Eigen::Vector3d>>;

TEST(View, BrowserShowsWhatTheBusSays) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  TemporaryDirectory directory;
  const World world = make_world(Task::kCircle, Environment::kPure, 3, 1, {.robots = 2, .circle_m = 2.5});
  write_text(directory / "world.json", to_json_text(world, directory.path()));
  write_text(directory / "slow.cfg", "lead = 0.4\nperiod = 0.3\nstale-map = 2\n");
  View view({"--world", directory / "world.json", "--three", kThree});
  Browser browser("http://127.0.0.1:" + std::to_string(view.port()) + "/");
  EXPECT_TRUE(browser.wait_until(30.0 * kPatience, "typeof shown !== 'undefined' && shown().mode === 'live'"));
  EXPECT_TRUE(browser.wait_until(5.0, "shown().message.startsWith('Nothing heard yet on udpm://')"));

  LcmBus first(onboard_url(0)), second(onboard_url(1));
  Places places;
  for (LcmBus* bus : {&first, &second}) {
    bus->subscribe(channel::kRobotState, [&](std::string_view, std::span<const std::uint8_t> bytes) {
      sogm_swarm::robot_state_t state;
      ASSERT_EQ(decode(bytes, &state), Refusal::kNone);
      places[state.header.robot_id].push_back(Eigen::Vector3d(state.position));
    });
  }
  std::vector<std::string> run = {"swarm_sim", "run",         directory / "world.json",   "--mode",
                                  "processes", "--base-port", std::to_string(base_port())};
  if (kSanitized) run.insert(run.end(), {"--planner-config", directory / "slow.cfg", "--sensor-rate", "3"});
  Program program(run);
  ASSERT_TRUE(browser.wait_until(60.0,
                                 "shown().robots.length === 2 && shown().robots.every((r) => r.trajectory) && "
                                 "shown().voxels > 0"))
      << browser.evaluate("shown()") << program.err();
  for (int look = 0; look < 10 && program.running(); ++look) {
    const WebJson shown = browser.evaluate("shown()");
    for (LcmBus* bus : {&first, &second})
      while (bus->drain() > 0) continue;
    ASSERT_EQ(shown["robots"].size(), 2u);
    for (const WebJson& robot : shown["robots"]) {
      const auto position = robot["position"].get<std::vector<double>>();
      const std::vector<Eigen::Vector3d>& said = places[robot["id"].get<int>()];
      EXPECT_TRUE(std::any_of(said.begin(), said.end(),
                              [&](const Eigen::Vector3d& place) {
                                return (place - Eigen::Vector3d(position.data())).cwiseAbs().maxCoeff() < 1e-3;
                              }))
          << robot << " after " << said.size() << " states";
    }
    std::this_thread::sleep_for(100ms);
  }
  const WebJson shown = browser.evaluate("shown()");
  EXPECT_EQ(shown["cards"].size(), 2u);
  EXPECT_GT(shown["obstacles"], 0);
  EXPECT_GT(shown["fps"], kSanitized ? 1.0 : 10.0);
  EXPECT_GT(browser.screenshot().size(), 20'000u);
}

// Scans and what stands of a robot that sees with a LiDAR, and the peer that is no obstacle.
TEST(View, BrowserShowsWhatSensorsSee) {
  if (!can_browse()) GTEST_SKIP() << kCannotBrowse;
  TemporaryDirectory out;
  World world = make_world(Task::kCircle, Environment::kPure, 6, 1, {.robots = 2, .circle_m = 2.5});
  world.sensor.kind = "lidar";
  fly(world, out.path());
  View view({out / "robot0.lcm", out / "robot1.lcm", out / "swarm.lcm", "--three", kThree});
  Browser browser("http://127.0.0.1:" + std::to_string(view.port()) + "/");
  ASSERT_TRUE(browser.wait_until(30.0 * kPatience, "typeof shown !== 'undefined' && shown().robots.length === 2"));
  (void)browser.evaluate("tell({seek: 1.5, play: false}), select(1)");
  EXPECT_TRUE(browser.wait_until(10.0 * kPatience,
                                 "shown().scan > 100 && shown().standing > 0 && shown().masks === 2 && "
                                 "shown().obstacles > 0 && shown().uncertain > 0 && "
                                 "shown().cards.some((card) => card.includes('scans'))"))
      << browser.evaluate("shown()");
  for (const char* const visible : {"false", "true"}) {
    browser.click_on("#show-sight");
    EXPECT_TRUE(browser.wait_until(10.0 * kPatience, std::string("scene.sight.visible === ") + visible));
  }
  (void)browser.evaluate("select(null)");
  EXPECT_TRUE(browser.wait_until(10.0 * kPatience, "shown().scan + shown().standing + shown().masks === 0"))
      << browser.evaluate("shown()");
}

}  // namespace
}  // namespace swarm::test
