#include "tests/bench/bench_growth.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <stdexcept>
#include <vector>

#include "lcmtypes/bus/atomic_file.h"
#include "planner_daemon/planner.h"
#include "swarm_sim/results/report.h"
#include "tests/support/random_map.h"
#include "tests/support/random_motion.h"
#include "tests/support/start_time.h"

namespace swarm {
namespace {

using Eigen::Vector3d;

constexpr Duration kFrame = 100ms;
constexpr int kRequests = 40, kRepeats = 5;
const Vector3d kWindow_m(10, 10, 4);

struct Work {
  int obstacles = 20, peers = 3;
  double horizon_s = 2.0, resolution_m = 0.1;
};

struct Measured {
  double value;
  TimingStats plan;
};

// In flight from the middle of the window past its edge, at 1.2 m/s.
PlanRequest request_among(const Sogm& sogm, const std::vector<Peer>& peers, Rng& rng) {
  MotionState start;
  do {
    start.position = in_box(rng, {-1, -1, -1}, {1, 1, 1});
  } while (distance_to_occupied(sogm, 0, start.position, 0.5) < 0.5);
  const Vector3d to_goal = Vector3d(direction(rng).cwiseProduct(Vector3d(1, 1, 0.1))).normalized();
  start.velocity = 1.2 * to_goal;
  MotionState rest;
  rest.position = start.position + 0.6 * to_goal;
  Trajectory own(1, kStart, 1s, 1);
  own.set_knot(0, start);
  own.set_knot(1, rest);
  return {.sogm = &sogm,
          .own = {own, {}},
          .start_utime = kStart + 50ms,
          .goal = start.position + 8.0 * to_goal,
          .peers = &peers};
}

TimingStats time_plans(const Work& work) {
  Rng rng(1);
  PlannerConfig config;
  config.search.num_pieces = std::min(10, static_cast<int>(std::lround(work.horizon_s / 0.2)));
  config.search.piece = to_duration(work.horizon_s / config.search.num_pieces);
  config.limits.space_min.z() = -1.8;
  config.limits.space_max.z() = 1.8;
  Planner planner(config);
  const int frames = static_cast<int>(std::lround(work.horizon_s / to_seconds(kFrame)));
  std::vector<double> samples_ms;
  for (int i = 0; i < kRequests; ++i) {
    const Sogm sogm = random_map(rng, work.obstacles, kWindow_m, frames, kStart, kFrame, work.resolution_m);
    std::vector<Peer> peers;
    while (static_cast<int>(peers.size()) < work.peers)
      peers.push_back({random_motion(rng, kStart - 500ms, 5.0), Trajectory(), 0.2});
    const PlanRequest request = request_among(sogm, peers, rng);
    for (int round = 0; round < kRepeats; ++round) {
      const auto begun = stopwatch();
      (void)planner.plan(request);
      const auto taken = stopwatch() - begun;
      if (round > 0) samples_ms.push_back(to_ms(taken));
    }
  }
  return timing_stats(std::move(samples_ms));
}

// Slope of the line through the medians' logarithms.
double exponent(const std::vector<Measured>& series) {
  double x_mean = 0.0, y_mean = 0.0, xy = 0.0, xx = 0.0;
  for (const Measured& m : series) {
    x_mean += std::log(m.value) / static_cast<double>(series.size());
    y_mean += std::log(m.plan.p50_ms) / static_cast<double>(series.size());
  }
  for (const Measured& m : series) {
    const double x = std::log(m.value) - x_mean;
    xy += x * (std::log(m.plan.p50_ms) - y_mean);
    xx += x * x;
  }
  return xy / xx;
}

}  // namespace

void measure_growth(const std::string& csv_path) {
  AtomicFile file(csv_path);
  std::ofstream csv(file.temporary());
  const auto check = [&] {
    if (!csv) throw std::runtime_error(csv_path + ": cannot be written");
  };
  check();
  csv << "work,value,p50_ms,p95_ms,p99_ms,exponent\n";
  const auto vary = [&](const char* name, const std::vector<double>& values, const auto& set) {
    std::vector<Measured> series;
    std::printf("%-14s %8s %8s %8s\n", name, "p50 ms", "p95 ms", "p99 ms");
    for (const double value : values) {
      Work work;
      set(value, &work);
      series.push_back({value, time_plans(work)});
      const TimingStats& plan = series.back().plan;
      std::printf("%14g %8.2f %8.2f %8.2f\n", value, plan.p50_ms, plan.p95_ms, plan.p99_ms);
      std::fflush(stdout);
    }
    const double slope = exponent(series);
    std::printf("%14s %8.2f\n\n", "exponent", slope);
    for (const Measured& m : series) {
      char line[160];
      std::snprintf(line, sizeof line, "%s,%g,%.4f,%.4f,%.4f,%.3f\n", name, m.value, m.plan.p50_ms, m.plan.p95_ms,
                    m.plan.p99_ms, slope);
      csv << line;
    }
  };
  vary("obstacles", {10, 20, 50, 100, 200},
       [](double value, Work* work) { work->obstacles = static_cast<int>(value); });
  vary("peers", {1, 2, 4, 8, 16, 32, 64}, [](double value, Work* work) { work->peers = static_cast<int>(value); });
  vary("horizon_s", {1.2, 1.6, 2.0, 3.0, 4.0}, [](double value, Work* work) { work->horizon_s = value; });
  vary("resolution_m", {0.2, 0.15, 0.1, 0.075, 0.05}, [](double value, Work* work) { work->resolution_m = value; });
  csv.close();
  check();
  file.commit();
}

}  // namespace swarm
