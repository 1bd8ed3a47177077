// What a broadcast daemon finds on its disk: of the copies that are whole the newest counts, and a robot that starts
// with whatever stands there flies on from where it is.
#include <limits>

#include "lcmtypes/bus/channels.h"
#include "planner_daemon/coordination/broadcast_node.h"
#include "planner_daemon/coordination/promise_store.h"
#include "tests/fuzz/fuzz_node.h"

namespace swarm::fuzz {
namespace {

class Store : public PromiseStore {
 public:
  explicit Store(Copies copies) : copies_(std::move(copies)) {}
  Copies load() override { return copies_; }
  bool save(std::span<const std::uint8_t> bytes) override {
    copies_ = {{bytes.begin(), bytes.end()}};
    return true;
  }

 private:
  Copies copies_;
};

class Bench : public NodeBench<Bench, BroadcastNode> {
 public:
  static BroadcastConfig config() {
    BroadcastConfig config;
    config.robot_id = kRobot;
    return config;
  }
  explicit Bench(PromiseStore& store) : NodeBench(config(), store, 7) { step(); }
};

}  // namespace

void try_input(FuzzInput input) {
  const auto place_of_robot = place(input, 5.0);
  const int delay_ms = input.integer(0, 2000);
  PromiseStore::Copies copies;
  std::vector<std::pair<Bytes, Bytes>> parts;  // of the copies: an announcement and a flight status
  for (int count = input.byte() % 3; count > 0; --count) {
    const Bytes promise = message_bytes(input, channel::kOwnTrajectory);
    const Bytes flight = message_bytes(input, channel::kFlightStatus);
    parts.emplace_back(promise, flight);
    copies.push_back(promise);
    copies.back().insert(copies.back().end(), flight.begin(), flight.end());
  }
  Store store(copies);
  const KeptPromise kept = load_promise(store, Bench::kRobot, 7);
  expect(kept.boot > 0, "starts are counted");
  for (const auto& [bytes, flight_bytes] : parts) {
    sogm_swarm::announcement_t promise;
    sogm_swarm::flight_status_t flight;
    if (decode(flight_bytes, &flight) != Refusal::kNone) continue;
    if (decode(bytes, &promise) != Refusal::kNone || promise.header.robot_id != Bench::kRobot) continue;
    if (promise.header.boot == std::numeric_limits<std::int32_t>::max()) continue;
    expect(kept.motion && kept.boot > promise.header.boot, "a start is later than what was promised before");
  }

  Bench bench(store);
  bench.run_for(Duration(delay_ms * 1000));
  sogm_swarm::robot_state_t state{};
  state.header = HeaderSource(Bench::kRobot, 1).next(bench.now);
  Eigen::Map<Eigen::Vector3d>(state.position) = place_of_robot;
  bench.send(BusId::kOnboard, channel::kRobotState, state);
  expect(bench.node.motion().has_value(), "with its state it has a motion");
  expect((bench.node.motion()->at(bench.now).position - place_of_robot).norm() < 0.501, "it flies on where it is");
  bench.run_for(300ms);
  // It starts again, and knows more than before.
  const KeptPromise then = load_promise(store, Bench::kRobot, 7);
  expect(then.boot > kept.boot && then.motion, "the next start goes on from this one");
}

}  // namespace swarm::fuzz
