// Kinodynamic A* through the SOGM (paper section IV-A): motion primitives of a double integrator with continuous
// acceleration, a time-optimal heuristic (Pontryagin), and survival to the horizon as the goal.
//
// A primitive lasts one trajectory piece (duration tau) and changes the acceleration from a0 to a1 as
// a(s) = a0 + (a1 - a0)(2 s - s^2), s in [0, 1]: monotone, so within the bounds when its ends are. A chain of
// primitives is a C2 quartic spline, hence exactly a `Trajectory` and a feasible point of the optimisation that
// follows.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "map_daemon/sogm.h"
#include "planner_daemon/search/space_time_heuristic.h"
#include "planner_daemon/space/zone_source.h"
#include "planner_daemon/trajectory/trajectory.h"

namespace swarm {

struct SearchLimits {
  double v_max = 2.0;                                           // per axis [m/s]
  double a_max = 6.0;                                           // per axis [m/s^2]
  Eigen::Vector3d space_min = Eigen::Vector3d::Constant(-1e3);  // flight space of the robot's centre, W [m]
  Eigen::Vector3d space_max = Eigen::Vector3d::Constant(1e3);
};

struct SearchOptions {
  std::int32_t piece_us = 200'000;  // duration tau of a primitive
  int num_pieces = 10;              // horizon in primitives, braking to rest included; <= Trajectory::kMaxPieces
  int max_expansions = 150;         // the budget, counted
  double heuristic_weight = 1.5;
  double cell_m = 0.3;    // closed set: position
  double cell_mps = 0.9;  // closed set: velocity
  double slow_mps = 0.6;  // nodes slower than this on every axis manoeuvre in a narrow place: a third of the cells,
                          // and axes slower than half of it also a quarter of the acceleration
  double effort_weight = 0.072;  // cost per second of full acceleration, with its square, on each axis
  double near_weight = 0.4;      // cost per second spent in the near zone; well below 1, or narrow places are shunned
  double wake_weight = 1.0;      // cost per second spent in an obstacle's wake, on top
  double leave_s = 0.45;         // a robot that starts in blocked space may take this long to leave it
  double leave_weight = 30.0;    // cost per second of that; ten times as much in the tight zone and again in contact
};

struct SearchProblem {
  MotionState start;
  std::int64_t start_utime = 0;
  Eigen::Vector3d goal = Eigen::Vector3d::Zero();  // W [m]
  const Sogm* blocked = nullptr;                   // configuration space: where the robot's centre may not be
  const Sogm* near = nullptr;                      // where it had rather not be; holds `blocked`; same geometry
  const Sogm* wake = nullptr;  // inside `near`: where an obstacle that turns comes back; may be null
  // Looked at only while leaving blocked space and in an emergency: ever nearer to a touch; each inside the one before;
  // same geometry.
  const Sogm* tight = nullptr;
  const Sogm* contact = nullptr;
  bool fine = true;                      // slow nodes manoeuvre finely (see slow_mps): narrow places, at a price
  bool emergency = false;                // nothing survives: blocked space may be passed, at the cost of leaving it
  const CostToGo* cost_to_go = nullptr;  // knows detours and waits; null: none
  ZoneSource* zones = nullptr;           // makes the zones; null: they are complete
};

enum class SearchStatus {
  kGoal,      // comes to rest at the goal within the horizon
  kSurvives,  // stays free and comes to rest at the horizon
  kPartial,   // no free motion survives: the longest one, free until free_until_utime
};
const char* to_string(SearchStatus status);

struct SearchResult {
  std::array<MotionState, Trajectory::kMaxPieces + 1> knots;
  int num_pieces = 0;                 // up to rest: fewer than the horizon when it rests at the goal earlier
  std::int64_t free_until_utime = 0;  // the path meets blocked space then; INT64_MAX: never within the map
  int expansions = 0;                 // nodes expanded; in an emergency ways out looked at
  bool settled = false;       // the budget was spent or nothing was left to expand: the best seen; not in an emergency
  bool left_blocked = false;  // it started in blocked space
};

// Time-optimal one-axis motion from (0, v) to rest at `d` under |v| <= v_max, |a| <= a_max [s]: lower bound of the
// axis' flight time.
double min_time_to_rest(double d, double v, double v_max, double a_max);

class KinodynamicSearch {
 public:
  // Throws std::invalid_argument when the braking distance does not fit the horizon (num_pieces too small).
  KinodynamicSearch(const SearchLimits& limits, const SearchOptions& options);

  // Primitives in which any reachable state comes to rest.
  static int brake_pieces(const SearchLimits& limits, std::int32_t piece_us);

  // Of the problem last searched: time to the goal, but for accelerations, of a robot that comes to rest there [s] ...
  double time_to_goal(const Eigen::Vector3d& position) const;
  // ... and what a motion costs from the start to the end of the map by passing blocked space (an emergency's cost).
  double harm(const Motion& motion) const;

  SearchStatus find(const SearchProblem& problem, SearchResult* result);

  // Next knot of one primitive towards acceleration `a1` (tests; the search itself works per axis).
  MotionState propagate(const MotionState& from, const Eigen::Vector3d& a1) const;

 private:
  static constexpr int kSamples = 8;  // collision checks per primitive
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();

  struct SampleWeights {  // position after each sample's time: p + v * .. + a0 * .. + a1 * ..
    std::array<double, kSamples> v, a0, a1;
  };
  struct AxisGrid {  // an axis of the maps and of the flight space
    double per_m;    // voxels
    std::int32_t origin, size;
    int shift, stride;          // voxels to words of the map
    std::uint64_t whole_words;  // x, y: all ones; z: 0, for voxels are bits
    double space_min, space_max;
  };
  // Where the samples of a primitive lie along one axis.
  struct AxisSamples {
    std::int32_t low, high;  // voxels, all on the way
    unsigned strays;         // bit i: sample i leaves the flight space; a robot outside may only come back
    // x, y: what sample i adds to the index of a word of the map; z: its word
    std::array<std::int32_t, kSamples> offset;
    // x, y: all ones inside the window, else 0; z: the sample's bit, or 0
    std::array<std::uint64_t, kSamples> in_window;
  };
  // What one axis does during a primitive; the axes are independent, so each option is worked out once for all
  // children.
  struct AxisOption {
    double position, velocity, acceleration;  // at the end of the primitive
    double time_to_goal;                      // min_time_to_rest from there
    double effort;                            // cost of the acceleration
    std::int32_t cell;                        // of the cost to go, at the end; -1: none
    AxisSamples samples;
  };
  struct AxisOptions {
    std::array<AxisOption, 6> option;
    int count = 0;
  };
  struct State {
    Eigen::Vector3d position, velocity, acceleration;
    MotionState motion() const { return {position, velocity, acceleration, Eigen::Vector3d::Zero()}; }
  };
  struct Node {
    State state;
    double cost = 0.0;
    double time_to_goal = 0.0;
    std::int32_t parent = -1;
    std::int16_t depth = 0;
  };
  struct OpenEntry {
    double priority;
    std::int32_t node;
  };

  static void place(const SampleWeights& weights, const AxisGrid& grid, double p, double v, double a, double a1,
                    AxisSamples* out);
  AxisSamples sample_axis(int axis, double p, double v, double a, double a1) const;
  double calm_down(double v, double a, double high) const;
  AxisOptions axis_options(int axis, const Node& node) const;
  // Has the zones made that the node's primitives pass.
  void prepare(const Node& node, const AxisOptions& xs, const AxisOptions& ys) const;
  // The words of the zones that hold the samples of a primitive, 0 outside the window; of wake and blocked zone only
  // where something is near.
  struct SampleWords {
    std::array<std::size_t, kSamples> index;
    std::array<std::uint64_t, kSamples> near, wake, blocked;
    std::uint64_t any_near;
  };
  SampleWords sample_words(const AxisSamples& x, const AxisSamples& y, const AxisSamples& z, int depth) const;
  // Cost of the zones one primitive passes; negative when it is blocked.
  double zone_cost(const SampleWords& words, const AxisSamples& z, int depth) const;
  bool blocked_at(const Eigen::Vector3d& position, int frame) const;
  double axis_time(int axis, double position, double velocity) const;
  static double time_to_goal(double x_s, double y_s, double z_s);  // from the axes' times
  // Child of a node by one primitive; -1 when it is blocked.
  std::int32_t add_child(std::int32_t index, const AxisOption& x, const AxisOption& y, const AxisOption& z,
                         const SampleWords& words);
  template <class Visit>
  void for_each_child(std::int32_t index, const Visit& visit);  // visit(child or -1)
  void hold(std::int32_t index);           // on from a node with the same accelerations, as far as it goes
  double total(std::int32_t index) const;  // cost and weighted time to the goal
  void push(std::int32_t index);           // on the open list, unless -1
  std::int32_t pop();
  SearchStatus escape(SearchResult* result);  // the answer to an emergency
  bool seen_before(const State& state, int depth);
  // Quintic from a node to rest at the goal in as few pieces as the limits allow, then hovering there, all free and out
  // of wakes.
  bool shoot(const Node& node, SearchResult* result);
  bool avoided_at(const Eigen::Vector3d& position, int frame) const;
  // From when on hovering at the goal is so until the horizon; INT64_MAX: never.
  std::int64_t goal_open_from() const;
  // Brakes to rest from a node and hovers to the end of horizon and map; the knots go to the result. Returns the first
  // blocked time or INT64_MAX; in an emergency nothing blocks, and `harm` is the cost of the zones passed.
  std::int64_t brake(const Node& node, SearchResult* result, double* harm) const;
  double harm_at(const Eigen::Vector3d& position, std::int64_t utime) const;  // cost per second
  double blocked_weight(double ahead_s, bool tight, bool contact) const;      // cost per second in blocked space
  // The budget is spent or nothing is left to expand: the node nearest to the goal that can come to rest, or else the
  // motion that stays free the longest.
  SearchStatus settle(SearchResult* result);
  void trace_back(std::int32_t index, SearchResult* result) const;
  bool leaving(int depth, int sample) const;

  SearchLimits limits_;
  SearchOptions options_;
  double tau_;
  double a_lim_;      // what primitives use of a_max: a little is left for rounding
  int brake_pieces_;  // any reachable state comes to rest in this many primitives
  int max_depth_;     // num_pieces - brake_pieces
  SampleWeights weights_;

  SearchProblem problem_;
  std::array<AxisGrid, 3> axes_;
  bool start_blocked_ = false;
  std::int64_t hover_until_utime_ = 0;
  std::optional<std::int64_t> goal_open_utime_;             // see goal_open_from(); once it was asked for
  std::vector<std::array<std::int32_t, kSamples>> frames_;  // first word of the map's frame, per depth and sample
  std::vector<int> goal_steps_;                             // of the cost to go, at the end of each depth
  std::vector<Node> nodes_;
  std::vector<OpenEntry> open_;
  std::vector<OpenEntry> ways_out_;
  std::vector<std::int32_t> expanded_;
  std::vector<std::uint64_t> closed_;  // open addressing, 0 = free
};

}  // namespace swarm
