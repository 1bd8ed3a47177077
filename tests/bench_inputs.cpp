#include "tests/bench_inputs.h"

#include <lcm/lcm-cpp.hpp>

#include "swarm_sim/lockstep.h"
#include "swarm_sim/trial.h"
#include "tests/harness.h"

namespace swarm {
namespace {

struct NoOutbox : Outbox {
  void publish_bytes(BusId, std::string_view, std::span<const std::uint8_t>) override {}
};

std::unique_ptr<PlanInput> copy_of(const PlanRequest& request) {
  auto input = std::make_unique<PlanInput>();
  input->sogm = *request.sogm;
  input->peers = *request.peers;
  input->request = request;
  input->request.sogm = &input->sogm;
  input->request.peers = &input->peers;
  return input;
}

}  // namespace

RecordedFlight record_flight(const std::string& task, const std::string& environment, int obstacles, int seed,
                             int stride) {
  const Trial trial = seeded_trial(task, environment, obstacles, seed);
  const World world = trial.world();
  std::vector<int> ids;
  for (const WorldRobot& robot : world.robots) ids.push_back(robot.id);
  const test::TemporaryDirectory directory;
  BusLog logs(directory.path(), ids);
  (void)run_lockstep(world, nullptr, {}, {}, &logs, nullptr, nullptr);
  logs.close();

  // A planner that hears what the first robot's heard makes the same plans.
  const PlannerNodeConfig config = planner_config(world, world.robots.front(), {});
  RecordedFlight flight{trial.name, config.planner, {}};
  PlannerNode node(config, 1, nullptr);
  NoOutbox outbox;
  lcm::LogFile log((directory / ("robot" + std::to_string(ids.front()) + ".lcm")).string(), "r");
  std::int64_t wake_us = 0;
  int plans = 0;
  const auto step = [&](std::int64_t now_us) {
    wake_us = node.step(now_us, outbox);
    if (node.plans() == plans) return;
    plans = node.plans();
    if (plans % stride == 0) flight.inputs.push_back(copy_of(node.newest_request()));
  };
  while (const lcm::LogEvent* event = log.readNextEvent()) {
    while (wake_us > 0 && wake_us < event->timestamp) step(wake_us);
    const auto* bytes = static_cast<const std::uint8_t*>(event->data);
    node.on_message(event->timestamp, BusId::kOnboard, event->channel,
                    {bytes, static_cast<std::size_t>(event->datalen)}, outbox);
    step(event->timestamp);
  }
  return flight;
}

}  // namespace swarm
