// planner_bench: how long the numerical steps take on inputs recorded from flights; `planner_bench --problems FILE`
// solves stored problems of the trajectory optimisation; `planner_bench --growth FILE` shows how plans take longer with
// more work.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "map_daemon/sogm_codec.h"
#include "swarm_sim/lockstep.h"
#include "swarm_sim/trial.h"
#include "tests/bench_growth.h"
#include "tests/bench_inputs.h"
#include "tests/qp_problems.h"

namespace swarm {
namespace {

constexpr int kRounds = 8;  // over all inputs

double now_us() {
  return 1e-3 * static_cast<double>(std::chrono::duration_cast<std::chrono::nanoseconds>(
                                        std::chrono::steady_clock::now().time_since_epoch())
                                        .count());
}

double quantile(const std::vector<double>& sorted, double q) {
  return sorted[static_cast<std::size_t>(q * static_cast<double>(sorted.size() - 1) + 0.5)];
}

template <class Call>
double timed_us(const Call& call) {
  const double begin = now_us();
  call();
  return now_us() - begin;
}

// A step of the pipeline, called once per input and round: prepares what it needs, then returns what to count [us];
// several values when the step is taken several times, as corridors are.
using Step = std::function<void(const PlanInput&, std::vector<double>*)>;

void run_step(benchmark::State& state, const RecordedFlight& flight, const Step& step) {
  std::vector<double> samples_us;
  std::size_t next = 0;
  for (auto _ : state) {
    const std::size_t before = samples_us.size();
    step(*flight.inputs[next++ % flight.inputs.size()], &samples_us);
    double sum_us = 0.0;
    for (std::size_t i = before; i < samples_us.size(); ++i) sum_us += samples_us[i];
    state.SetIterationTime(1e-6 * sum_us);
  }
  std::sort(samples_us.begin(), samples_us.end());
  if (samples_us.empty()) return state.SkipWithError("never happened in these inputs");
  state.counters["calls"] = static_cast<double>(samples_us.size());
  for (const int percent : {50, 95, 99})
    state.counters["p" + std::to_string(percent) + "_us"] = quantile(samples_us, 0.01 * percent);
}

// What the authors' public code takes for a step on a server core [us] (median, 99 %; their planner or the library it
// calls); 0: not known.
struct Reference {
  double p50_us, p99_us;
};
const std::map<std::string, Reference> kReference = {
    {"in flight, plan", {4480, 30'900}},     {"in flight, search", {130, 2400}}, {"in flight, corridor", {1320, 2200}},
    {"in flight, optimize", {2380, 28'900}}, {"plan", {4480, 30'900}},           {"search", {130, 2400}},
    {"search, per node", {178, 0}},          {"corridor, per piece", {160, 0}},  {"optimise", {2380, 28'900}},
    {"dilate 0.3 m, whole", {287'000, 0}},
};

class Table : public benchmark::BenchmarkReporter {
 public:
  bool ReportContext(const Context&) override {
    std::printf("%-44s %8s %9s %9s %9s %11s %11s %7s\n", "step", "calls", "p50 us", "p95 us", "p99 us", "authors p50",
                "authors p99", "ratio");
    return true;
  }
  void ReportRuns(const std::vector<Run>& runs) override {
    for (const Run& run : runs) {
      const std::string name = run.benchmark_name().substr(0, run.benchmark_name().find("/iterations"));
      if (run.error_occurred) {
        std::printf("%-44s %s\n", name.c_str(), run.error_message.c_str());
        continue;
      }
      const double p50 = run.counters.at("p50_us");
      std::printf("%-44s %8.0f %9.2f %9.2f %9.2f", name.c_str(), double{run.counters.at("calls")}, p50,
                  double{run.counters.at("p95_us")}, double{run.counters.at("p99_us")});
      const auto at = kReference.find(name.substr(0, name.find(':')));
      if (at != kReference.end()) {
        std::printf(" %11.0f", at->second.p50_us);
        at->second.p99_us > 0 ? std::printf(" %11.0f", at->second.p99_us) : std::printf(" %11s", "");
        std::printf(" %6.1fx", at->second.p50_us / p50);
      }
      std::printf("\n");
    }
    std::fflush(stdout);
  }
};

// Plans and maps as they are made in flight: all four robots of one world of each task and environment. Means over the
// flights of each flight's percentiles.
class Flights {
 public:
  explicit Flights(int obstacles) : obstacles_(obstacles) {
    for (std::size_t step = 0; step < kPlanningSteps.size(); ++step) {
      const std::string name = kPlanningSteps[step];
      add(name == "total" ? "plan" : name, [step](const RunReport& report) { return report.planning[step]; });
    }
    add("map and its wire", [](const RunReport& report) { return report.mapping; });
  }

 private:
  template <class Select>
  void add(const std::string& name, const Select& select) {
    const std::string title = "in flight, " + name + ": " + std::to_string(obstacles_) + " obstacles";
    const auto run = [this, select](benchmark::State& state) {
      if (reports_.empty()) fly();
      std::map<std::string, double> sums;
      const auto share = 1.0 / static_cast<double>(reports_.size());
      for (const RunReport& report : reports_) {
        const TimingStats stats = select(report);
        sums["calls"] += static_cast<double>(stats.count);
        sums["p50_us"] += 1e3 * share * stats.p50_ms;
        sums["p95_us"] += 1e3 * share * stats.p95_ms;
        sums["p99_us"] += 1e3 * share * stats.p99_ms;
      }
      for (auto _ : state) state.SetIterationTime(1e-6);
      for (const auto& [counter, value] : sums) state.counters[counter] = value;
    };
    benchmark::RegisterBenchmark(title.c_str(), run)->UseManualTime()->Iterations(1);
  }
  void fly() {
    for (const char* task : {"cross", "bilateral", "unilateral"}) {
      for (const char* environment : {"pure", "mixed"}) {
        const World world = seeded_trial(task, environment, obstacles_, 1).world();
        std::fprintf(stderr, "planner_bench: flying %s\n", world.name.c_str());
        reports_.push_back(run_lockstep(world, nullptr, {}, {}, nullptr, nullptr, nullptr));
      }
    }
  }

  int obstacles_;
  std::vector<RunReport> reports_;
};

// All steps on one recorded flight. Every call comes after a whole plan, so that caches are as cold as in flight. The
// requests lie so far apart that each plan makes its guidance anew, which in flight every fifth does.
class Bench {
 public:
  explicit Bench(const RecordedFlight& flight)
      : flight_(flight),
        planner_(flight.config, [] { return static_cast<std::int64_t>(1e3 * now_us()); }),
        search_(usable(flight.config), flight.config.search),
        corridors_(flight.config.limits.space_min, flight.config.limits.space_max, flight.config.corridor) {
    add("plan", [this](const PlanInput& input, auto* us) {
      us->push_back(timed_us([&] { benchmark::DoNotOptimize(planner_.plan(input.request)); }));
    });
    for (int step = 0; step < kNumPlanSteps; ++step) {
      add(std::string("  of it ") + to_string(static_cast<PlanStep>(step)),
          [this, step](const PlanInput& input, auto* us) {
            us->push_back(1e3 * planner_.plan(input.request).step_ms[static_cast<std::size_t>(step)]);
          });
    }
    add("search", [this](const PlanInput& input, auto* us) { us->push_back(search_us(input)); });
    add("search, per node", [this](const PlanInput& input, auto* us) {
      const double all_us = search_us(input);
      if (path_.expansions >= 5) us->push_back(all_us / path_.expansions);
    });
    add("cost to go", [this](const PlanInput& input, auto* us) {
      planner_.plan(input.request);
      us->push_back(timed_us([&] { planner_.build_cost_to_go(input.request); }));
    });
    add("corridor, per piece", [this](const PlanInput& input, auto* us) {
      planner_.plan(input.request);
      const SearchResult& path = planner_.path();
      const std::int32_t piece_us = flight_.config.search.piece_us;
      for (int k = 0; k < path.num_pieces; ++k) {
        const auto index = static_cast<std::size_t>(k);
        const ControlPoints piece = quintic_control_points(path.knots[index], path.knots[index + 1], 1e-6 * piece_us);
        const std::int64_t from = input.request.start_utime + k * std::int64_t{piece_us};
        us->push_back(timed_us([&] {
          (void)corridors_.build(piece, planner_.occupancy(), flight_.config.zones.blocked_m(), from, from + piece_us,
                                 &polytope_);
        }));
      }
    });
    add("optimise", [this](const PlanInput& input, auto* us) {
      const PlanResult& result = planner_.plan(input.request);
      if (result.outcome != PlanOutcome::kSmooth) return;
      const auto pieces = planner_.spline_problem().corridors.size();
      auto& solver = solvers_[pieces];
      if (!solver)
        solver = std::make_unique<SplineQp>(5, std::vector<double>(pieces, 1e-6 * flight_.config.search.piece_us));
      us->push_back(timed_us([&] { (void)solver->solve(planner_.spline_problem(), &solution_); }));
    });
    add("dilate 0.3 m, whole", [this](const PlanInput& input, auto* us) {
      decoded_ = input.sogm;  // it has just arrived
      us->push_back(timed_us([&] { dilator_.dilate(decoded_, 0.3, &dilated_); }));
    });
    add("encode map", [this](const PlanInput& input, auto* us) {
      us->push_back(timed_us([&] { benchmark::DoNotOptimize(encoder_.encode(input.sogm, {}).size()); }));
    });
    add("decode map", [this](const PlanInput& input, auto* us) {
      sogm_swarm::header_t header{};
      header.seq = ++sequence_;
      const auto parts = encoder_.encode(input.sogm, header);
      us->push_back(timed_us([&] {
        for (const sogm_swarm::sogm_t& part : parts) (void)assembler_.add(part, &decoded_);
      }));
    });
  }

 private:
  static SearchLimits usable(const PlannerConfig& config) {
    SearchLimits limits = config.limits;
    limits.v_max *= Planner::kUsableSpeed;
    return limits;
  }
  void add(const std::string& name, const Step& step) {
    const std::string title = name + ": " + flight_.name;
    benchmark::RegisterBenchmark(title.c_str(),
                                 [this, step](benchmark::State& state) { run_step(state, flight_, step); })
        ->UseManualTime()
        ->Iterations(static_cast<benchmark::IterationCount>(kRounds * flight_.inputs.size()));
  }
  double search_us(const PlanInput& input) {
    planner_.plan(input.request);
    SearchProblem problem = planner_.search_problem();
    problem.fine = problem.emergency = false;
    return timed_us([&] { (void)search_.find(problem, &path_); });
  }

  const RecordedFlight& flight_;
  Planner planner_;
  KinodynamicSearch search_;
  SearchResult path_;
  CorridorBuilder corridors_;
  Polytope polytope_;
  std::map<std::size_t, std::unique_ptr<SplineQp>> solvers_;  // by number of pieces
  SplineSolution solution_;
  Dilator dilator_;
  Sogm dilated_;
  SogmEncoder encoder_;
  SogmAssembler assembler_;
  Sogm decoded_;
  std::int64_t sequence_ = 0;
};

// One JSON line each: name, status, jerk_integral, violation, time_us (the median of nine calls of a warm solver).
int solve_problems(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error("cannot be read");
  std::map<std::pair<int, std::vector<double>>, SplineQp> solvers;
  std::vector<double> times_us;
  int solved = 0;
  for (const StoredQp& stored : read_qp_problems(file)) {
    SplineQp& solver =
        solvers.try_emplace({stored.degree, stored.durations_s}, stored.degree, stored.durations_s).first->second;
    SplineSolution solution;
    SplineStatus status = SplineStatus::kInfeasible;
    std::vector<double> calls_us;
    for (int call = 0; call < 9; ++call)
      calls_us.push_back(timed_us([&] { status = solver.solve(stored.problem, &solution); }));
    std::sort(calls_us.begin(), calls_us.end());
    nlohmann::ordered_json line = {{"name", stored.name}, {"status", to_string(status)}};
    line["jerk_integral"] = status == SplineStatus::kSolved ? nlohmann::ordered_json(solution.jerk_integral) : nullptr;
    line["violation"] = solution.max_violation;
    line["time_us"] = quantile(calls_us, 0.5);
    std::cout << line.dump() << '\n';
    times_us.push_back(quantile(calls_us, 0.5));
    solved += status == SplineStatus::kSolved;
  }
  if (times_us.empty()) throw std::runtime_error("holds no problem");
  std::sort(times_us.begin(), times_us.end());
  std::fprintf(stderr, "%zu problems, %d solved; p50 %.1f us, p95 %.1f us, p99 %.1f us, largest %.1f us\n",
               times_us.size(), solved, quantile(times_us, 0.5), quantile(times_us, 0.95), quantile(times_us, 0.99),
               times_us.back());
  return 0;
}

constexpr const char* kUsage =
    "Usage: planner_bench [--benchmark_filter=REGEX]\n"
    "       planner_bench --problems FILE.jsonl\n"
    "       planner_bench --growth FILE.csv\n"
    "Without arguments: how long plans and maps take in lock-step flights with 50 obstacles, and each numerical\n"
    "step on the planning requests of one robot in two of them (20 and 50 columns), beside the authors' public code.\n"
    "  --problems FILE  solves stored problems of the trajectory optimisation and prints one JSON line each\n"
    "  --growth FILE    times plans with ever more obstacles, peers, horizon and resolution; the table goes to FILE\n";

int bench(int argc, char** argv) {
  if (argc == 3 && std::strcmp(argv[1], "--problems") == 0) {
    try {
      return solve_problems(argv[2]);
    } catch (const std::exception& error) {
      throw std::runtime_error(std::string(argv[2]) + ": " + error.what());
    }
  }
  if (argc == 3 && std::strcmp(argv[1], "--growth") == 0) {
    measure_growth(argv[2]);
    return 0;
  }
  if (argc == 2 && (std::strcmp(argv[1], "--help") == 0 || std::strcmp(argv[1], "-h") == 0)) {
    std::cout << kUsage;
    return 0;
  }
  benchmark::Initialize(&argc, argv);
  if (argc > 1) throw std::runtime_error(std::string("unknown argument ") + argv[1] + "\n" + kUsage);
  std::fprintf(stderr, "planner_bench: flying two worlds for their inputs\n");
  std::vector<std::unique_ptr<RecordedFlight>> flights;
  std::vector<std::unique_ptr<Bench>> benches;
  const Flights in_flight(50);
  for (const int obstacles : {20, 50}) {
    flights.push_back(std::make_unique<RecordedFlight>(record_flight("cross", "pure", obstacles, 1, 6)));
    benches.push_back(std::make_unique<Bench>(*flights.back()));
  }
  Table table;
  benchmark::RunSpecifiedBenchmarks(&table);
  return 0;
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) {
  try {
    return swarm::bench(argc, argv);
  } catch (const std::exception& error) {
    std::cerr << "planner_bench: " << error.what() << '\n';
    return 2;
  }
}
