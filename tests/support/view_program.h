// The view as a program, and robots for it to show, live or from a log.
#pragma once

#include <algorithm>
#include <filesystem>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/lcm_bus.h"
#include "lcmtypes/bus/node_clock.h"
#include "planner_daemon/trajectory/trajectory.h"
#include "swarm_sim/hosts/lockstep.h"
#include "swarm_sim/results/recorder.h"
#include "swarm_sim/world/world_generator.h"
#include "tests/support/harness.h"
#include "tests/support/web_browser.h"

namespace swarm::test {

inline constexpr const char* kThree = "/usr/share/javascript/three";
inline constexpr const char* kCannotBrowse = "Chromium or libjs-three is not installed (tools/setup --view --browser)";
inline bool can_browse() {
  return Browser::is_installed() && std::filesystem::exists(kThree);
}

// Files in place of three.js, for whoever only wants the stream.
class View {
 public:
  explicit View(std::vector<std::string> words) {
    for (const char* name :
         {"build/three.min", "examples/js/controls/OrbitControls", "examples/js/lines/LineSegmentsGeometry",
          "examples/js/lines/LineGeometry", "examples/js/lines/LineMaterial", "examples/js/lines/LineSegments2",
          "examples/js/lines/Line2"}) {
      const auto path = three_ / (std::string(name) + ".js");
      std::filesystem::create_directories(path.parent_path());
      write_text(path, "// " + std::string(name));
    }
    words.insert(words.begin(), "swarm_view");
    words.insert(words.end(), {"--port", "0", "--base-port", std::to_string(base_port())});
    if (std::find(words.begin(), words.end(), "--three") == words.end())
      words.insert(words.end(), {"--three", three_ / ""});
    program_.emplace(words);
    wait_for(20.0, [&] {
      const std::string out = program_->out();
      const std::size_t at = out.find("http://127.0.0.1:");
      if (at != out.npos && out.find('/', at + 8) != out.npos) port_ = std::atoi(out.c_str() + at + 17);
      return port_ != 0 || !program_->running();
    });
    if (port_ == 0) throw std::runtime_error("the view does not start: " + program_->err());
  }

  int port() const { return port_; }
  Program& program() { return *program_; }
  std::int64_t resident_kb() const {
    std::istringstream status(read_text("/proc/" + std::to_string(program_->pid()) + "/status"));
    for (std::string word; status >> word;) {
      std::int64_t size = 0;
      if (word == "VmRSS:" && status >> size) return size;
    }
    return 0;
  }

 private:
  TemporaryDirectory three_;
  std::optional<Program> program_;
  int port_ = 0;
};

inline std::string onboard_url(int robot) {
  return "udpm://239.255.76.67:" + std::to_string(base_port() + 33 + robot) + "?ttl=0";
}

// A robot that hovers, by its state and its announcement.
inline void publish_hover(LcmBus& bus, int robot, const Eigen::Vector3d& position, std::int64_t seq) {
  const Utime now = wall_utime();
  EXPECT_TRUE(bus.publish(channel::kRobotState, encoded(state_at(robot, position, seq, now))));
  sogm_swarm::announcement_t announcement{};
  announcement.header = make_header(robot, 1, seq, now);
  announcement.radius = 0.25f;
  announcement.committed = Trajectory::hover(1, now, position).to_wire();
  announcement.least_delay_us = sogm_swarm::announcement_t::kUnknown;
  EXPECT_TRUE(bus.publish(channel::kOwnTrajectory, encoded(announcement)));
}

// A short flight in lock-step, recorded.
inline void fly(const World& world, const std::filesystem::path& out) {
  std::filesystem::create_directories(out);
  BusLog logs(out, {0, 1});
  FlightOptions options;
  options.time_limit_s = 2.0;
  run_lockstep(world, nullptr, options, {}, &logs, nullptr, nullptr);
  logs.close();
}
inline void fly(const std::filesystem::path& out) {
  fly(make_world(Task::kCircle, Environment::kPure, 6, 1, {.robots = 2, .circle_m = 2.5}), out);
}

}  // namespace swarm::test
