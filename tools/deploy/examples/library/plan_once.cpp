// One plan, without daemons, messages or a clock: a robot hovers at the origin, a person walks across its way to a goal
// 4 m ahead. Prints the plan as a line for each tenth of a second: time, position, and how far it is from the person.
#include <iostream>

#include "map_daemon/obstacle.h"
#include "planner_daemon/planner.h"

using namespace std::chrono_literals;

int main() {
  const swarm::Utime now = swarm::to_utime(1'700'000'000'000'000);

  // The map: a window of 10 m x 10 m x 3 m around the robot, what will be occupied in each 0.2 s of the next 2.2 s.
  swarm::GridGeometry window;
  window.size = {100, 100, 30};   // voxels of 0.1 m
  window.origin = {-50, -50, 0};  // of the first one
  swarm::Sogm sogm;
  sogm.reset(window, 11, now, 200ms);
  swarm::Obstacle person;
  person.shape = {swarm::Shape::Kind::kColumn, {0.6, 1.9, 0.0}};  // diameter, height
  person.position = {1.8, -0.5, 0.95};                            // W [m]: of its middle
  person.velocity = {0.0, 0.5, 0.0};
  person.utime = now;
  swarm::rasterize(person, 0.0, 0.0, &sogm);  // no margin, none that grows with time

  swarm::PlannerConfig config;
  config.space.radius_m = 0.2;
  config.limits.v_max_mps = 2.0;
  config.limits.space_min = {-5.0, -5.0, 0.3};
  config.limits.space_max = {5.0, 5.0, 2.5};
  swarm::Planner planner(config);

  const std::vector<swarm::Peer> nobody;
  swarm::PlanRequest request;
  request.sogm = &sogm;
  request.own.committed = swarm::Trajectory::hover(1, now - 1s, {0.0, 0.0, 1.0});
  request.start_utime = now + 50ms;
  request.goal = {4.0, 0.0, 1.0};
  request.peers = &nobody;
  const swarm::PlanResult& plan = planner.plan(request);

  std::cout << "outcome: " << swarm::to_string(plan.outcome) << '\n';
  for (swarm::Utime t = plan.trajectory.start_utime(); t <= plan.trajectory.end_utime(); t += 100ms) {
    const Eigen::Vector3d at = plan.trajectory.at(t).position;
    const double seconds = swarm::to_seconds(t - now);
    const double apart = swarm::distance(person.shape, at - (person.position + seconds * person.velocity));
    std::cout << seconds << ' ' << at.transpose() << ' ' << apart << '\n';
  }
  return plan.fly ? 0 : 1;
}
