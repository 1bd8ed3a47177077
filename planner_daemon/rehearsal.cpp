#include "planner_daemon/rehearsal.h"

#include <array>
#include <cstdlib>
#include <vector>

namespace swarm {
namespace {

constexpr Utime kNow{1'000s};
struct Pillars {
  int spacing;  // voxels; 1: they close the world, 0: there are none
  int speed;    // voxels a frame along x
};
constexpr std::array<Pillars, 7> kWorlds = {{{12, 2}, {8, 2}, {20, 2}, {30, 2}, {1, 2}, {0, 2}, {20, 0}}};
constexpr int kPlansEach = 2;  // in flight, and hovering: at the goal, or stuck where they stand
constexpr int kPillar = 4;     // voxels: their edge
constexpr int kPeers = 4;
constexpr Duration kStuck = 3s;  // whoever came no nearer for so long looks for a way out

// In the middle of the window there is none at first.
void set_pillars(const Pillars& pillars, Sogm* world) {
  const GridGeometry& grid = world->geometry;
  const auto is_in_pillar = [&](int way) { return std::abs(way) % pillars.spacing >= pillars.spacing - kPillar; };
  for (int frame = 0; pillars.spacing > 0 && frame < world->num_frames; ++frame) {
    for (int x = 0; x < grid.size.x(); ++x) {
      for (int y = 0; y < grid.size.y(); ++y) {
        if (is_in_pillar(x - grid.size.x() / 2 + pillars.speed * frame) && is_in_pillar(y - grid.size.y() / 2))
          set_run(0, grid.size.z(), grid.size.z(), world->column(frame, x, y));
      }
    }
  }
}

// From `place` straight on for a second.
Trajectory flight(const Eigen::Vector3d& place, const Eigen::Vector3d& velocity) {
  constexpr int kPieces = 5;
  constexpr Duration kPiece = 200ms;
  Trajectory flight(1, kNow, kPiece, kPieces);
  for (int k = 0; k <= kPieces; ++k) {
    MotionState knot;
    knot.position = place + k * to_seconds(kPiece) * velocity;
    if (k < kPieces) knot.velocity = velocity;
    flight.set_knot(k, knot);
  }
  return flight;
}

}  // namespace

bool Rehearsal::plan(const Sogm& map, Planner* planner) {
  const GridGeometry& grid = map.geometry;
  const Eigen::Vector3d size = grid.size.cast<double>() * grid.resolution_m;
  const auto in_flight_space = [this](const Eigen::Vector3d& place) {
    return place.cwiseMax(limits_.space_min).cwiseMin(limits_.space_max);
  };
  const Eigen::Vector3d place = in_flight_space(grid.center_of(grid.size / 2));
  const Eigen::Vector3d velocity = limits_.v_max_mps * Eigen::Vector3d(0.7, 0.5, 0.0);
  Sogm world;
  world.reset(grid, map.num_frames, kNow, map.frame_duration);
  const Pillars& pillars = kWorlds[static_cast<std::size_t>(plans_ / kPlansEach)];
  set_pillars(pillars, &world);
  std::vector<Peer> peers(kPeers);
  for (int k = 0; k < kPeers; ++k) {
    const int row = k / 2;
    const Eigen::Vector3d beside = place + Eigen::Vector3d((k % 2 - 0.5) * size.x(), (row - 0.5) * size.y(), 0) / 4;
    Peer& peer = peers[static_cast<std::size_t>(k)];
    peer.motion = {flight(beside, -velocity), {}};
    peer.pending = flight(beside, velocity);
    peer.silent = k == 0;
  }
  const bool hovers = plans_ % kPlansEach == 1, is_stuck = hovers && pillars.speed == 0;
  PlanRequest request;
  request.sogm = &world;
  request.peers = &peers;
  request.own = {hovers ? Trajectory::hover(1, kNow - 1s, place) : flight(place, velocity), {}};
  request.start_utime = kNow + 50ms;
  if (is_stuck) {
    const double way_m = 1.5 * pillars.spacing * grid.resolution_m;  // between pillars
    request.goal = in_flight_space(place + Eigen::Vector3d(way_m, way_m, 0));
  } else {
    request.goal = hovers ? place : in_flight_space(place + size / 2);
  }
  (void)planner->plan(request);
  if (is_stuck) {
    world.start_utime += kStuck;
    request.start_utime += kStuck;
    (void)planner->plan(request);
  }
  planner->prepare(request);
  planner->forget();
  return ++plans_ < kPlansEach * std::ssize(kWorlds);
}

}  // namespace swarm
