// tools/plot_run and tools/movie: what they draw of a run is what swarm_sim reports of it, worked out by themselves.
#include <nlohmann/json.hpp>
#include <regex>

#include "tests/support/harness.h"

namespace swarm::test {
namespace {

namespace fs = std::filesystem;

Finished run_tool(const std::string& tool, std::vector<std::string> words) {
  std::string command = std::string(SWARM_SOURCE_DIR) + "/tools/" + tool;
  for (const std::string& word : words) command += " '" + word + "'";
  return run_program(std::vector<std::string>{"/bin/sh", "-c", command}, 120.0);
}

bool has_matplotlib() {
  return run_program(std::vector<std::string>{"/bin/sh", "-c", "/usr/bin/python3 -c 'import matplotlib'"}).exit_code ==
         0;
}

// Every shape, one that turns, two that accelerate and one on a track that ends.
constexpr const char* kWorld = R"({"name": "shapes",
 "space": {"min": [-8,-8,0], "max": [8,8,4]}, "obstacle_bounds": {"min": [-4,-4], "max": [4,4]},
 "limits": {"speed": 2.0, "acceleration": 6.0},
 "robots": [{"id": 3, "start": [-5,0,1], "goal": [5,0.2,1], "radius": 0.2},
  {"id": 7, "start": [5,0,1], "goal": [-5,0,1.5], "radius": 0.3}],
 "obstacles": [{"shape": "column", "center": [0,3.5], "diameter": 0.8, "height": 4.0, "velocity": [-0.3,0.6], "acceleration": 1},
  {"shape": "ring", "center": [2,0,1.2], "radius": 1.5, "width": 0.1, "yaw": 0.4, "velocity": [0.1,0.2]},
  {"shape": "box", "center": [-2,-1,1], "size": [1.5,0.4,2], "yaw": 0.7},
  {"shape": "sphere", "center": [-3,1.2,1], "diameter": 0.9, "velocity": [0.2,0.1], "acceleration": 0.5},
  {"shape": "column", "diameter": 0.6, "height": 3, "track": [[0,0,2],[1,1,1.5],[3,1,-3]]}]})";

TEST(RunPlot, DrawsWhatWasReported) {
  if (!has_matplotlib()) GTEST_SKIP() << "needs Matplotlib";
  const TemporaryDirectory directory;
  write_text(directory / "shapes.json", kWorld);
  const Finished flown = run_program(std::vector<std::string>{"swarm_sim", "run", directory / "shapes.json",
                                                              "--time-limit", "6", "--out", directory / "run"});
  ASSERT_NE(flown.exit_code, 2) << flown.err;
  const Finished drawn = run_tool("plot_run", {directory / "run", "--out", directory / "pictures"});
  ASSERT_EQ(drawn.exit_code, 0) << drawn.err;
  for (const char* name : {"from_above.svg", "from_above.png", "over_time.svg", "over_time.png"})
    EXPECT_GT(fs::file_size(directory / "pictures" / name), 10'000u) << name;
  const auto report = nlohmann::json::parse(read_text(directory / "run/report.json"));
  for (const auto& robot : report["robots"]) {
    for (const char* kind : {"obstacle", "robot"}) {
      const auto& clearance = robot["clearance"][std::string(kind) + "s"];
      const std::regex line("  robot " + robot["id"].dump() + ": ([0-9.]+) m to the nearest " + kind +
                            " at ([0-9.]+) s");
      std::smatch found;
      ASSERT_TRUE(std::regex_search(drawn.out, found, line)) << kind << " is missing in:\n" << drawn.out;
      EXPECT_NEAR(std::stod(found[1]), clearance["distance"].get<double>(), 6e-5);  // of a rounded trace
      EXPECT_NEAR(std::stod(found[2]), clearance["t"].get<double>(), 1e-9);
    }
  }
}

TEST(RunPlot, AnimatedSvgHoldsAllThatMoves) {
  if (!has_matplotlib()) GTEST_SKIP() << "needs Matplotlib";
  const TemporaryDirectory directory;
  write_text(directory / "shapes.json", kWorld);
  const Finished flown = run_program(std::vector<std::string>{"swarm_sim", "run", directory / "shapes.json",
                                                              "--time-limit", "6", "--out", directory / "run"});
  ASSERT_NE(flown.exit_code, 2) << flown.err;
  const Finished drawn = run_tool("movie", {directory / "run", "--out", directory / "run.svg"});
  ASSERT_EQ(drawn.exit_code, 0) << drawn.err;
  const std::string svg = read_text(directory / "run.svg");
  EXPECT_TRUE(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
  EXPECT_EQ(svg.find("nan"), svg.npos);
  const auto count = [&svg](const std::string& text) {
    int found = 0;
    for (std::size_t at = 0; (at = svg.find(text, at)) != svg.npos; ++at) ++found;
    return found;
  };
  EXPECT_EQ(count("class=\"robot\""), 2);
  EXPECT_EQ(count("class=\"way\""), 2);
  EXPECT_EQ(count("class=\"column\""), 4);  // with box and sphere
  EXPECT_EQ(count("class=\"ring\""), 1);
  EXPECT_EQ(count("<animateTransform "), 2 + 5);
}

TEST(RunPlot, BadInputIsNamed) {
  if (!has_matplotlib()) GTEST_SKIP() << "needs Matplotlib";
  const TemporaryDirectory directory;
  const auto expect = [](const Finished& finished, const std::string& text) {
    EXPECT_EQ(finished.exit_code, 2);
    EXPECT_NE(finished.err.find(text), std::string::npos) << finished.err;
  };
  expect(run_tool("plot_run", {directory / "none"}), "world.json");
  expect(run_tool("plot_run", {}), "the directory of a run must be given");
  expect(run_tool("plot_run", {directory / "none", "--time", "soon"}), "--time soon");
  expect(run_tool("movie", {directory / "none", "--out", "run.avi"}), "run.avi: must end in .mp4, .gif or .svg");
  write_text(directory / "world.json", kWorld);
  write_text(directory / "report.json", "{}");
  write_text(directory / "trace.csv", "t,robot,x,y,z,vx,vy,vz,ax,ay,az\n0,3,1,2,3,0,0,0,0,0,0\n");
  expect(run_tool("plot_run", {directory / "."}), "must hold every robot");
  write_text(directory / "trace.csv", "t,robot\n0,x\n");
  expect(run_tool("plot_run", {directory / "."}), "cannot be understood");
}

}  // namespace
}  // namespace swarm::test
