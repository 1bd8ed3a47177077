// planner_bench: how long plans take in flight, and the numerical steps on planning requests recorded from flights;
// stored problems of the trajectory optimisation, and how plans take longer with more work, by its options.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "map_daemon/sogm_codec.h"
#include "swarm_sim/campaign/trial.h"
#include "swarm_sim/hosts/lockstep.h"
#include "tests/bench/bench_growth.h"
#include "tests/bench/bench_inputs.h"
#include "tests/support/qp_problems.h"
#include "tests/support/random_motion.h"

namespace swarm {
namespace {

constexpr int kRounds = 8;                 // over all inputs
constexpr std::size_t kMostRequests = 64;  // of a log
constexpr double kFullVolumeGap = 0.01;    // of FIRI's ellipsoids: as good as the largest
constexpr int kVolumePoints = 2000;

double quantile(const std::vector<double>& sorted, double q) {
  return sorted[static_cast<std::size_t>(q * static_cast<double>(sorted.size() - 1) + 0.5)];
}

template <class Call>
double timed_us(const Call& call) {
  const auto begun = stopwatch();
  call();
  return 1e3 * to_ms(stopwatch() - begun);
}

// A step of the pipeline, called once per input and round: prepares what it needs, then returns what to count [us];
// several values when the step is taken several times, as corridors are.
using Step = std::function<void(const PlanInput&, std::vector<double>*)>;

void run_step(benchmark::State& state, const RecordedRequests& requests, const Step& step) {
  std::vector<double> samples_us;
  std::size_t next = 0;
  for (auto _ : state) {
    const std::size_t before = samples_us.size();
    step(*requests.inputs[next++ % requests.inputs.size()], &samples_us);
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
    std::printf("%-44s %8s %9s %9s %9s %11s %11s %7s\n", "step [us, unless it says so]", "calls", "p50", "p95", "p99",
                "authors p50", "authors p99", "ratio");
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
      add(name == "total" ? "plan" : name == "prepare" ? "between two plans" : name, [step](const RunReport& report) { return report.planning[step]; });
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

// All steps on one set of recorded requests. Every call comes after a whole plan, so that caches are as cold as in
// flight. The requests lie so far apart that each plan makes its heuristics anew, which in flight every fifth
// does.
class Bench {
 public:
  explicit Bench(const RecordedRequests& requests)
      : requests_(requests),
        planner_(requests.config, &stopwatch),
        search_(usable(requests.config), requests.config.search),
        corridors_(requests.config.corridor),
        full_corridors_(full(requests.config.corridor)) {
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
    add("heuristics", [this](const PlanInput& input, auto* us) {
      planner_.plan(input.request);
      us->push_back(timed_us([&] { planner_.build_heuristics(input.request); }));
    });
    add("corridor, per piece", [this](const PlanInput& input, auto* us) {
      for_each_piece(input, [&](const ControlPoints& piece, Utime from) {
        us->push_back(timed_us([&] { (void)build(&corridors_, piece, from, &polytope_); }));
      });
    });
    // How much of what two full iterations would give each piece lacks, by random points in a box around both.
    add("corridor lacks of full volume [%]", [this](const PlanInput& input, auto* lack) {
      for_each_piece(input, [&](const ControlPoints& piece, Utime from) {
        Polytope full;
        if (build(&corridors_, piece, from, &polytope_) != FiriStatus::kGrown ||
            build(&full_corridors_, piece, from, &full) != FiriStatus::kGrown)
          return;
        const double extent_m = requests_.config.corridor.extent_m;
        const Eigen::Vector3d low = piece.rowwise().minCoeff().array() - extent_m;
        const Eigen::Vector3d high = piece.rowwise().maxCoeff().array() + extent_m;
        int inside = 0, inside_full = 0;
        for (int i = 0; i < kVolumePoints; ++i) {
          const Eigen::Vector3d point = in_box(rng_, low, high);
          inside += polytope_.violation(point) <= 0.0;
          inside_full += full.violation(point) <= 0.0;
        }
        if (inside_full > 0) lack->push_back(100.0 - 100.0 * inside / inside_full);
      });
    });
    add("optimise", [this](const PlanInput& input, auto* us) {
      const PlanResult& result = planner_.plan(input.request);
      if (result.outcome != PlanOutcome::kSmooth) return;
      const auto pieces = planner_.spline_problem().corridors.size();
      auto& solver = solvers_[pieces];
      if (!solver)
        solver = std::make_unique<SplineQp>(5, std::vector<double>(pieces, to_seconds(requests_.config.search.piece)));
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
    limits.v_max_mps *= Planner::kUsableSpeed;
    return limits;
  }
  void add(const std::string& name, const Step& step) {
    const std::string title = name + ": " + requests_.name;
    benchmark::RegisterBenchmark(title.c_str(),
                                 [this, step](benchmark::State& state) { run_step(state, requests_, step); })
        ->UseManualTime()
        ->Iterations(static_cast<benchmark::IterationCount>(kRounds * requests_.inputs.size()));
  }
  // Of a new plan: visit(control points, begin) for the pieces of the path.
  template <class Visit>
  void for_each_piece(const PlanInput& input, const Visit& visit) {
    planner_.plan(input.request);
    const SearchResult& path = planner_.path();
    const Duration piece = requests_.config.search.piece;
    for (std::size_t k = 0; k < static_cast<std::size_t>(path.num_pieces); ++k) {
      visit(quintic_control_points(path.knots[k], path.knots[k + 1], to_seconds(piece)),
            input.request.start_utime + static_cast<int>(k) * piece);
    }
  }
  FiriStatus build(CorridorBuilder* corridors, const ControlPoints& piece, Utime from, Polytope* polytope) {
    const SearchLimits& limits = requests_.config.limits;
    const Eigen::AlignedBox3d space =
        Eigen::AlignedBox3d(limits.space_min, limits.space_max).intersection(planner_.search_problem().space->known());
    return corridors->build(piece, planner_.occupancy(), requests_.config.space.blocked_m(), space, from,
                            from + requests_.config.search.piece, polytope);
  }
  static CorridorOptions full(CorridorOptions options) {
    options.log_volume_gap = kFullVolumeGap;
    return options;
  }
  double search_us(const PlanInput& input) {
    planner_.plan(input.request);
    SearchProblem problem = planner_.search_problem();
    problem.fine = false;
    return timed_us([&] { (void)search_.find(problem, &path_); });
  }

  const RecordedRequests& requests_;
  Planner planner_;
  KinodynamicSearch search_;
  SearchResult path_;
  CorridorBuilder corridors_, full_corridors_;
  Polytope polytope_;
  std::map<std::size_t, std::unique_ptr<SplineQp>> solvers_;  // by number of pieces
  SplineSolution solution_;
  Dilator dilator_;
  Sogm dilated_;
  SogmEncoder encoder_;
  SogmAssembler assembler_;
  Sogm decoded_;
  std::int64_t sequence_ = 0;
  Rng rng_{1};
};

// One JSON line each: name, status, jerk_integral, violation, time_us (the median of nine calls of a warm solver).
void solve_problems(const std::string& path) {
  std::map<std::pair<int, std::vector<double>>, SplineQp> solvers;
  std::vector<double> times_us;
  int solved = 0;
  for (const StoredQp& stored : read_qp_problems(path)) {
    SplineQp& solver =
        solvers.try_emplace({stored.degree, stored.durations_s}, stored.degree, stored.durations_s).first->second;
    SplineSolution solution;
    SplineStatus status = SplineStatus::kInfeasible;
    std::vector<double> calls_us;
    calls_us.reserve(9);
    for (int call = 0; call < 9; ++call)
      calls_us.push_back(timed_us([&] { status = solver.solve(stored.problem, &solution); }));
    std::sort(calls_us.begin(), calls_us.end());
    nlohmann::ordered_json line = {{"name", stored.name}, {"status", to_string(status)}};
    line["jerk_integral"] =
        status == SplineStatus::kSolved ? nlohmann::ordered_json(solution.jerk_integral) : nlohmann::ordered_json();
    line["violation"] = solution.max_violation;
    line["time_us"] = quantile(calls_us, 0.5);
    std::cout << line.dump() << '\n';
    times_us.push_back(quantile(calls_us, 0.5));
    solved += status == SplineStatus::kSolved;
  }
  std::sort(times_us.begin(), times_us.end());
  std::fprintf(stderr, "%zu problems, %d solved; p50 %.1f us, p95 %.1f us, p99 %.1f us, largest %.1f us\n",
               times_us.size(), solved, quantile(times_us, 0.5), quantile(times_us, 0.95), quantile(times_us, 0.99),
               times_us.back());
}

constexpr const char* kUsage =
    "How long plans and maps take in lock-step flights with 50 obstacles, and each numerical step on stored planning\n"
    "requests: of two flights, and of searches that got stuck; beside the authors' public code.";

int bench(int argc, char** argv) {
  std::string problems, growth, log, planner_config, record;
  OptionSet options("planner_bench", kUsage);
  options.add("problems", &problems,
              "only solve the problems of the trajectory optimisation in this JSONL file; prints one JSON line each");
  options.add(
      "growth", &growth,
      "only time plans with ever more obstacles, peers, horizon and resolution; the table goes to this CSV file");
  options.add("log", &log, "only the steps, on the requests in this LCM log of a robot's onboard bus");
  options.add("planner-config", &planner_config, "of the planner_daemon that log belongs to; none: its defaults");
  options.add("record", &record, "only fly and store the requests again, in this directory");
  const auto is_own = [](const char* argument) { return std::strncmp(argument, "--benchmark_", 12) != 0; };
  char** const others = std::stable_partition(argv + 1, argv + argc, is_own);
  std::vector<char*> own(argv, others), google(1, argv[0]);
  google.insert(google.end(), others, argv + argc);
  if (options.parse(static_cast<int>(own.size()), own.data(), std::cout) == OptionSet::Parsed::kExit) return 0;
  if (!problems.empty()) return solve_problems(problems), 0;
  if (!growth.empty()) return measure_growth(growth), 0;
  if (!record.empty()) return record_requests(record), 0;

  int num_google = static_cast<int>(google.size());
  benchmark::Initialize(&num_google, google.data());
  if (num_google > 1) throw OptionError(std::string("unknown argument ") + google[1]);
  std::vector<std::unique_ptr<RecordedRequests>> requests;
  std::vector<std::unique_ptr<Bench>> benches;
  std::optional<Flights> in_flight;
  const auto add = [&](const std::filesystem::path& path, const PlannerNodeConfig& config) {
    requests.push_back(std::make_unique<RecordedRequests>(read_requests(path, config, kMostRequests)));
    benches.push_back(std::make_unique<Bench>(*requests.back()));
  };
  if (!log.empty()) {
    add(log, read_planner_config(planner_config));
  } else {
    in_flight.emplace(50);
    const std::filesystem::path stored = SWARM_SOURCE_DIR "/tests/bench/requests";
    for (const char* name : {"20_columns", "50_columns", "stuck"})
      add(stored / (std::string(name) + ".lcm"), read_planner_config(stored / "planner.cfg"));
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
