#include "tests/bench/bench_inputs.h"

#include <algorithm>
#include <fstream>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <map>
#include <stdexcept>
#include <utility>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/channels.h"
#include "swarm_sim/campaign/flight_arguments.h"
#include "swarm_sim/campaign/trial.h"
#include "swarm_sim/hosts/lockstep.h"
#include "tests/support/harness.h"

namespace swarm {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kRequestsPerSet = 20;
constexpr int kSeed = 41;

struct NoOutbox : Outbox {
  void publish_bytes(BusId, std::string_view, std::span<const std::uint8_t>) override {}
};

std::span<const std::uint8_t> bytes_of(const lcm::LogEvent& event) {
  return {static_cast<const std::uint8_t*>(event.data), static_cast<std::size_t>(event.datalen)};
}

std::unique_ptr<lcm::LogFile> opened(const fs::path& path, const char* mode) {
  auto log = std::make_unique<lcm::LogFile>(path.string(), mode);
  if (!log->good()) throw std::runtime_error(path.string() + ": cannot be opened");
  return log;
}

// Whose maps the log holds.
int robot_in(const fs::path& path) {
  const auto log = opened(path, "r");
  while (const lcm::LogEvent* event = log->readNextEvent()) {
    sogm_swarm::sogm_t part;
    if (event->channel == channel::kSogm && decode(bytes_of(*event), &part) == Refusal::kNone)
      return part.header.robot_id;
  }
  throw std::runtime_error(path.string() + ": holds no map on channel " + std::string(channel::kSogm));
}

// A planner hears the log. on_event(event) before each message, on_plan(node, utime) after each plan.
void play(const fs::path& path, const PlannerNodeConfig& config,
          const std::function<void(const lcm::LogEvent&)>& on_event,
          const std::function<void(const PlannerNode&, Utime)>& on_plan) {
  PlannerNode node(config, 1, nullptr);
  NoOutbox outbox;
  const auto log = opened(path, "r");
  Utime wake{};
  int plans = 0;
  const auto step = [&](Utime now) {
    wake = node.step(now, outbox);
    if (node.plans() != plans) on_plan(node, now);
    plans = node.plans();
  };
  while (const lcm::LogEvent* event = log->readNextEvent()) {
    const Utime recorded = to_utime(event->timestamp);
    while (wake > Utime() && wake < recorded) step(wake);
    on_event(*event);
    node.on_message(recorded, BusId::kOnboard, event->channel, bytes_of(*event), outbox);
    step(recorded);
  }
}

// At most `most` of `all`, evenly.
std::vector<int> evenly(const std::vector<int>& all, std::size_t most) {
  if (all.size() <= most) return all;
  std::vector<int> chosen;
  for (std::size_t i = 0; i < most; ++i) chosen.push_back(all[i * all.size() / most]);
  return chosen;
}

std::unique_ptr<PlanInput> copy_of(const PlanRequest& request) {
  auto input = std::make_unique<PlanInput>();
  input->sogm = *request.sogm;
  input->peers = *request.peers;
  input->request = request;
  input->request.sogm = &input->sogm;
  input->request.peers = &input->peers;
  return input;
}

// What the planner knows: the newest message of each sender on each channel, and the parts of the newest map.
class Heard {
 public:
  void hear(const lcm::LogEvent& event) {
    const auto bytes = bytes_of(event);
    if (event.channel == channel::kSogm) {
      sogm_swarm::sogm_t part;
      if (decode(bytes, &part) != Refusal::kNone) return;
      if (part.header.seq != map_seq_) map_.clear();
      map_seq_ = part.header.seq;
      map_.emplace_back(event.channel, test::Bytes(bytes.begin(), bytes.end()));
    } else if (event.channel == channel::kOwnTrajectory || event.channel == channel::kPeerTrajectory) {
      sogm_swarm::announcement_t message;
      if (decode(bytes, &message) == Refusal::kNone)
        newest_[{event.channel, message.header.robot_id}] = test::Bytes(bytes.begin(), bytes.end());
    } else if (event.channel == channel::kGoal) {
      newest_[{event.channel, 0}] = test::Bytes(bytes.begin(), bytes.end());
    }
  }
  void write(Utime utime, lcm::LogFile* log) const {
    const auto add = [&](const std::string& channel, const test::Bytes& bytes) {
      lcm::LogEvent event{};
      event.timestamp = to_us(utime);
      event.channel = channel;
      event.datalen = static_cast<std::int32_t>(bytes.size());
      event.data = const_cast<std::uint8_t*>(bytes.data());  // only read
      if (log->writeEvent(&event) != 0) throw std::runtime_error("the log cannot be written");
    };
    for (const auto& [sender, bytes] : newest_) add(sender.first, bytes);
    for (const auto& [channel, bytes] : map_) add(channel, bytes);
  }

 private:
  std::map<std::pair<std::string, int>, test::Bytes> newest_;
  std::vector<std::pair<std::string, test::Bytes>> map_;
  std::int64_t map_seq_ = -1;
};

// Plans of the log that `wanted` says yes to, by number.
std::vector<int> plans_in(const fs::path& log, const PlannerNodeConfig& config,
                          const std::function<bool(const PlannerNode&)>& wanted) {
  std::vector<int> plans;
  play(
      log, config, [](const auto&) {},
      [&](const PlannerNode& node, Utime) {
        if (wanted(node)) plans.push_back(node.plans());
      });
  return plans;
}

void keep(const fs::path& in, const PlannerNodeConfig& config, const std::vector<int>& plans, const fs::path& out) {
  AtomicFile file(out);
  {
    const auto log = opened(file.temporary(), "w");
    Heard heard;
    play(
        in, config, [&](const lcm::LogEvent& event) { heard.hear(event); },
        [&](const PlannerNode& node, Utime utime) {
          if (std::binary_search(plans.begin(), plans.end(), node.plans())) heard.write(utime, log.get());
        });
  }
  file.commit();
}

void write_config(PlannerNodeConfig config, const fs::path& path) {
  AtomicFile file(path);
  std::ofstream out(file.temporary());
  OptionSet options("planner_bench", "");
  declare(options, config);
  const char* arguments[] = {"planner_bench", "--print-config"};
  (void)options.parse(2, arguments, out);
  out.close();
  if (!out) throw std::runtime_error(path.string() + ": cannot be written");
  file.commit();
}

}  // namespace

PlannerNodeConfig read_planner_config(const std::string& file) {
  FlightArguments arguments;
  arguments.planner_config = file;
  return flight_options(arguments).planner;
}

RecordedRequests read_requests(const fs::path& log, PlannerNodeConfig config, std::size_t most) {
  config.robot_id = robot_in(log);
  RecordedRequests requests{log.stem().string(), config.planner, {}};
  const std::vector<int> plans = evenly(plans_in(log, config, [](const auto&) { return true; }), most);
  if (plans.empty()) throw std::runtime_error(log.string() + ": nothing was planned with what it holds");
  play(
      log, config, [](const auto&) {},
      [&](const PlannerNode& node, Utime) {
        if (std::binary_search(plans.begin(), plans.end(), node.plans()))
          requests.inputs.push_back(copy_of(node.newest_request()));
      });
  return requests;
}

void record_requests(const fs::path& directory) {
  fs::create_directories(directory);
  const auto any = [](const PlannerNode&) { return true; };
  const auto is_stuck = [](const PlannerNode& node) {
    return node.newest_plan().expansions >= SearchOptions().max_expansions;
  };
  const auto record = [&](const std::string& name, const Trial& trial, const auto& wanted) {
    std::fprintf(stderr, "planner_bench: flying %s for %s\n", trial.name.c_str(), name.c_str());
    const World world = trial.world();
    std::vector<int> ids;
    for (const WorldRobot& robot : world.robots) ids.push_back(robot.id);
    const TemporaryDirectory flown;
    BusLog logs(flown.path(), ids);
    (void)run_lockstep(world, nullptr, {}, {}, &logs, nullptr, nullptr);
    logs.close();
    // Of the robot with the most such plans.
    fs::path most_log;
    PlannerNodeConfig most_config;
    std::vector<int> most;
    for (const WorldRobot& robot : world.robots) {
      const fs::path log = flown / ("robot" + std::to_string(robot.id) + ".lcm");
      const PlannerNodeConfig config = planner_config(world, robot, {});
      std::vector<int> plans = plans_in(log, config, wanted);
      if (plans.size() > most.size()) most = std::move(plans), most_log = log, most_config = config;
    }
    keep(most_log, most_config, evenly(most, kRequestsPerSet), directory / (name + ".lcm"));
    write_config(most_config, directory / "planner.cfg");
  };
  record("20_columns", seeded_trial("cross", "pure", 20, kSeed), any);
  record("50_columns", seeded_trial("cross", "pure", 50, kSeed), any);
  record("stuck", seeded_trial("unilateral", "pure", 50, kSeed), is_stuck);
}

}  // namespace swarm
