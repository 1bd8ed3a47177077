// Whole flights in lock-step: success, the same bytes every time, logs that can be read, motions that can be flown.
// Long because every promise about a flight is looked up in one.
#include "swarm_sim/hosts/lockstep.h"

#include <octomap/octomap.h>

#include <lcm/lcm-cpp.hpp>
#include <map>
#include <set>

#include "lcmtypes/bus/channels.h"
#include "swarm_sim/world/walls.h"
#include "swarm_sim/world/world_generator.h"
#include "tests/support/harness.h"
#include "tests/support/sensor_phases.h"

namespace swarm::test {
namespace {

namespace fs = std::filesystem;

// One line of trace.csv.
struct Row {
  double t_s;
  Eigen::Vector3d position, velocity, acceleration;
};

std::map<int, std::vector<Row>> read_trace(const fs::path& path) {
  std::map<int, std::vector<Row>> rows;
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  EXPECT_EQ(line, "t,robot,x,y,z,vx,vy,vz,ax,ay,az");
  while (std::getline(in, line)) {
    std::array<double, 11> v;
    std::istringstream cells(line);
    std::string cell;
    for (double& value : v) value = std::getline(cells, cell, ',') ? std::stod(cell) : NAN;
    rows[static_cast<int>(v[1])].push_back({v[0], {v[2], v[3], v[4]}, {v[5], v[6], v[7]}, {v[8], v[9], v[10]}});
  }
  return rows;
}

// A flight that leaves all its files in a directory of its own.
struct Flight {
  explicit Flight(const World& world_in, const FlightOptions& options = {}, int threads = 1) : world(world_in) {
    std::vector<int> ids;
    for (const WorldRobot& robot : world.robots) ids.push_back(robot.id);
    BusLog logs(directory.path(), ids);
    FlightTrace trace(directory.path(), world.vehicle.kind == "perfect");
    std::optional<OccupiedCubes> static_map;
    if (!world.static_map.empty()) static_map = OccupiedCubes::load(world.static_map);
    report = run_lockstep(world, static_map ? &*static_map : nullptr, options, {}, &logs, &trace, nullptr, threads);
    logs.close();
    trace.close();
  }

  TemporaryDirectory directory;
  World world;
  RunReport report;
};

World circle(int robots, double radius_m, int obstacles, std::uint64_t seed) {
  const Environment environment = obstacles == 0 ? Environment::kEmpty : Environment::kPure;
  return make_world(Task::kCircle, environment, obstacles, seed, {.robots = robots, .circle_m = radius_m});
}

// Continuous, within the limits, from start to goal.
void expect_flyable(const Flight& flight) {
  const auto trace = read_trace(flight.directory / "trace.csv");
  const double v_max_mps = 1.01 * flight.world.limits.v_max_mps, a_max_mps2 = 1.01 * flight.world.limits.a_max_mps2;
  ASSERT_EQ(trace.size(), flight.world.robots.size());
  for (const WorldRobot& robot : flight.world.robots) {
    const std::vector<Row>& rows = trace.at(robot.id);
    ASSERT_EQ(rows.size(), std::llround(100 * flight.report.duration_s) + 1);
    EXPECT_LT((rows.front().position - robot.start).norm(), 1e-5);
    double to_goal = INFINITY;  // it may have stepped aside after its arrival
    for (const Row& row : rows) to_goal = std::min(to_goal, (row.position - robot.goal()).norm());
    EXPECT_LT(to_goal, 0.1);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      SCOPED_TRACE(testing::Message() << "robot " << robot.id << ", row " << i << ", " << rows[i].t_s << " s");
      ASSERT_NEAR(rows[i].t_s, 0.01 * static_cast<double>(i), 1e-9);
      ASSERT_LE(rows[i].velocity.cwiseAbs().maxCoeff(), v_max_mps);
      ASSERT_LE(rows[i].acceleration.cwiseAbs().maxCoeff(), a_max_mps2);
      if (i == 0) continue;
      const Row &a = rows[i - 1], &b = rows[i];
      ASSERT_LT((b.position - a.position - 0.005 * (a.velocity + b.velocity)).norm(), 1.5e-4);  // knots are rounded
      ASSERT_LT((b.velocity - a.velocity - 0.005 * (a.acceleration + b.acceleration)).norm(), 5e-3);
      ASSERT_LT((b.acceleration - a.acceleration).norm(), 2.5);
    }
  }
}

// Calls `read(utime, channel, bytes)` for every event; times must not go back.
void read_log(const fs::path& path,
              const std::function<void(Utime, const std::string&, std::span<const std::uint8_t>)>& read) {
  lcm::LogFile log(path.string(), "r");
  ASSERT_TRUE(log.good()) << path;
  Utime before{};
  while (const lcm::LogEvent* event = log.readNextEvent()) {
    const Utime utime = to_utime(event->timestamp);
    ASSERT_GE(utime, before);
    before = utime;
    read(utime, event->channel,
         {static_cast<const std::uint8_t*>(event->data), static_cast<std::size_t>(event->datalen)});
  }
}

template <class T>
void expect_message(std::span<const std::uint8_t> bytes, Utime sent) {
  T message;
  const Refusal refusal = decode(bytes, &message);
  ASSERT_EQ(refusal, Refusal::kNone) << to_string(refusal);
  EXPECT_LE(to_utime(message.header.utime), sent);
  EXPECT_GT(to_utime(message.header.utime), sent - 100ms);
}

// With nothing but what sensors see: the same bytes every time, and no robot takes a peer for an obstacle.
TEST(Lockstep, RobotsFlyByWhatTheirSensorsSee) {
  for (const char* sensor : {"lidar", "depth"}) {
    SCOPED_TRACE(sensor);
    World world = make_world(Task::kCross, Environment::kPure, 5, 3);
    world.sensor.kind = sensor;
    world.sensor.pose_noise_m = 0.02;
    world.sensor.pose_noise_deg = 0.3;
    FlightOptions options;
    if (world.sensor.kind == "depth") options.time_limit_s = 2.0;
    if (kSanitized) options.time_limit_s = 0.5;
    const Flight flight(world, options);
    const Outcome expected = options.time_limit_s < 60.0 ? Outcome::kTimeout : Outcome::kSuccess;
    EXPECT_EQ(flight.report.outcome, expected) << summary_table(flight.report);
    EXPECT_TRUE(flight.report.touches.empty());
    const Flight again(world, options);
    EXPECT_EQ(read_text(flight.directory / "robot0.lcm"), read_text(again.directory / "robot0.lcm"));
  }
}

TEST(Lockstep, FourRobotsAmongObstaclesArrive) {
  const Flight flight(circle(4, 2.5, 4, 3));
  EXPECT_EQ(flight.report.outcome, Outcome::kSuccess) << summary_table(flight.report);
  EXPECT_TRUE(flight.report.touches.empty());
  expect_flyable(flight);
  for (const RobotReport& robot : flight.report.robots) {
    EXPECT_TRUE(robot.verdict.flight_time_s);
    EXPECT_GT(robot.verdict.to_obstacles.distance_m, 0.0);
    EXPECT_GT(robot.verdict.to_robots.distance_m, 0.0);
    EXPECT_LT(robot.verdict.to_robots.distance_m, 4.0);  // they did meet
    EXPECT_GE(robot.plan_rate_hz, 3.9);                  // a plan each calm period at least
    for (const std::int64_t refused : robot.refused) EXPECT_EQ(refused, 0);
  }
}

TEST(Lockstep, TwoRobotsSwapPlacesWithoutObstacles) {
  const Flight flight(circle(2, 2.0, 0, 1));
  EXPECT_EQ(flight.report.outcome, Outcome::kSuccess) << summary_table(flight.report);
  expect_flyable(flight);
  EXPECT_LT(flight.report.duration_s, 8.0);
  EXPECT_FALSE(std::isfinite(flight.report.robots[0].verdict.to_obstacles.distance_m));
}

TEST(Lockstep, TheSameRunGivesTheSameBytesWithAnyNumberOfThreads) {
  const World world = circle(2, 2.5, 5, 2);
  const Flight first(world), second(world, {}, 3);
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(first.directory.path())) names.insert(entry.path().filename());
  EXPECT_EQ(names, (std::set<std::string>{"robot0.lcm", "robot1.lcm", "swarm.lcm", "trace.csv"}));
  for (const std::string& name : names) {
    const std::string text = read_text(first.directory / name);
    EXPECT_GT(text.size(), 10'000u) << name;
    EXPECT_TRUE(text == read_text(second.directory / name)) << name << " differs";
  }
  auto json = [](RunReport report) {  // all but what the wall clock had a hand in
    report.wall_s = 0;
    report.planning = {};
    report.mapping = {};
    return to_json(report).dump();
  };
  EXPECT_EQ(json(first.report), json(second.report));
}

TEST(Lockstep, LogsHoldEveryMessageAndWhatWasAnnouncedIsWhatWasFlown) {
  const Flight flight(circle(2, 2.5, 3, 4));
  using namespace sogm_swarm;
  const std::map<std::string, std::function<void(std::span<const std::uint8_t>, Utime)>> channels = {
      {channel::kRobotState, expect_message<robot_state_t>},
      {channel::kObstacles, expect_message<obstacles_t>},
      {channel::kGoal, expect_message<goal_t>},
      {channel::kSogm, expect_message<sogm_t>},
      {channel::kCandidate, expect_message<candidate_t>},
      {channel::kOwnTrajectory, expect_message<announcement_t>},
      {channel::kPeerTrajectory, expect_message<announcement_t>},
      {channel::kSetpoint, expect_message<setpoint_t>},
      {channel::kCorridors, expect_message<corridors_t>},
      {channel::kMapStatus, expect_message<map_status_t>},
      {channel::kPlannerStatus, expect_message<planner_status_t>},
      {channel::kBroadcastStatus, expect_message<broadcast_status_t>},
      {channel::kFlightStatus, expect_message<flight_status_t>}};
  std::map<std::string, std::int64_t> counts;
  for (const WorldRobot& robot : flight.world.robots) {
    std::set<std::string> seen;
    read_log(flight.directory / ("robot" + std::to_string(robot.id) + ".lcm"),
             [&](Utime time, const std::string& channel, std::span<const std::uint8_t> bytes) {
               const auto check = channels.find(channel);
               SCOPED_TRACE(channel);
               ASSERT_NE(check, channels.end());
               check->second(bytes, time);
               seen.insert(channel);
               ++counts[channel];
             });
    EXPECT_EQ(seen.size(), channels.size());
  }
  struct Announced {
    Utime time;
    Motion motion, other;  // once what waits is committed
  };
  std::map<int, std::vector<Announced>> announced;
  read_log(flight.directory / "swarm.lcm", [&](Utime time, const std::string& channel, auto bytes) {
    announcement_t message;
    ASSERT_EQ(channel, channel::kAnnouncement);
    ASSERT_EQ(decode_packed(bytes, &message), Refusal::kNone);
    const Motion motion = motion_of(message), other{motion.committed, Trajectory::from_wire(message.pending)};
    announced[message.header.robot_id].push_back({time, motion, other});
    ++counts[channel];
  });
  for (const auto& [name, count] : flight.report.channels) EXPECT_EQ(counts[name], count.messages) << name;
  for (const int robot : {0, 1})
    expect_sensor_phases(flight.directory / ("robot" + std::to_string(robot) + ".lcm"), robot);

  // What a robot said last before a time tells where it is then: it may fly what all have agreed to before it says so.
  const auto trace = read_trace(flight.directory / "trace.csv");
  for (const auto& [robot, said] : announced) {
    std::size_t newest = 0;
    std::set<std::int32_t> flown;
    for (const Row& row : trace.at(robot)) {
      const Utime time = Utime(1'000'000'000s) + to_duration(row.t_s);
      while (newest + 1 < said.size() && said[newest + 1].time < time) ++newest;
      if (said[newest].time > time) continue;
      const auto apart_m = [&](const Motion& motion) { return (motion.at(time).position - row.position).norm(); };
      const auto& [when, motion, other] = said[newest];
      const MotionState state = (apart_m(motion) < apart_m(other) ? motion : other).at(time);
      flown.insert(motion.committed.seq());
      ASSERT_LT((state.position - row.position).norm(), 3e-6) << "robot " << robot << ", " << row.t_s << " s";
      ASSERT_LT((state.velocity - row.velocity).norm(), 1e-4) << "robot " << robot << ", " << row.t_s << " s";
    }
    EXPECT_GT(flown.size(), 10u);  // plan after plan
  }
}

TEST(Lockstep, FliesAroundTheStaticMap) {
  TemporaryDirectory directory;
  octomap::OcTree wall(0.1);
  for (double y = -0.95; y < 1; y += 0.1) {
    for (double z = 0.05; z < 4; z += 0.1)
      wall.updateNode(octomap::point3d(0.05f, static_cast<float>(y), static_cast<float>(z)), true);
  }
  wall.updateInnerOccupancy();
  ASSERT_TRUE(wall.writeBinary((directory / "wall.bt").string()));
  World world = circle(2, 2.5, 0, 1);
  world.static_map = directory / "wall.bt";
  const Flight flight(world);
  EXPECT_EQ(flight.report.outcome, Outcome::kSuccess) << summary_table(flight.report);
  for (const RobotReport& robot : flight.report.robots) {
    EXPECT_GT(robot.verdict.to_static_map.distance_m, 0.0);
    EXPECT_LT(robot.verdict.to_static_map.distance_m, 1.0);
    EXPECT_GT(robot.verdict.path_length_m, 5.3);  // 5.0 straight through
  }
}

// Robots of limited jerk and tilt, among obstacles: what is flown keeps both.
TEST(Lockstep, FliesWithinJerkAndThrust) {
  World world = circle(4, 4.0, 10, 3);
  world.limits.j_max_mps3 = 50.0;
  world.limits.kind = "thrust";
  world.limits.thrust = {4.0, 18.0, 35.0};
  FlightOptions options;
  options.time_limit_s = 20.0;
  const Flight flight(world, options);
  EXPECT_EQ(flight.report.outcome, Outcome::kSuccess) << summary_table(flight.report);
  double most_mps3 = 0.0, most_tilt_deg = 0.0;
  for (const auto& [id, rows] : read_trace(flight.directory / "trace.csv")) {
    for (std::size_t i = 1; i < rows.size(); ++i) {
      most_mps3 = std::max(most_mps3, (rows[i].acceleration - rows[i - 1].acceleration).cwiseAbs().maxCoeff() /
                                          (rows[i].t_s - rows[i - 1].t_s));
      const Eigen::Vector3d thrust = rows[i].acceleration + Eigen::Vector3d(0, 0, 9.81);
      most_tilt_deg = std::max(most_tilt_deg, std::acos(thrust.z() / thrust.norm()) * 180.0 / M_PI);
    }
  }
  EXPECT_LT(most_mps3, 1.02 * 50.0);
  EXPECT_GT(most_mps3, 35.0);
  EXPECT_LT(most_tilt_deg, 35.2);
  EXPECT_GT(most_tilt_deg, 25.0);
}

// From rest before a board: too many weak accelerations for the search's budget lead past its edge.
TEST(Lockstep, FliesAroundABoardFromRest) {
  for (const double limit : {1.0, 2.0}) {
    TemporaryDirectory directory;
    World world = circle(2, 2.0, 0, 1);
    world.robots.resize(1);
    world.limits.v_max_mps = world.limits.a_max_mps2 = limit;
    world.robots[0].start = {-0.45, 0, 1};
    world.robots[0].mission = {{{1.0, 0, 1}}};
    world.walls.push_back({{-0.1, -0.3, 0}, {0.1, 0.3, 4}});
    FlightOptions options;
    options.time_limit_s = 10.0;
    const Flight flight(with_walls_in_file(world, directory.path()), options);
    EXPECT_EQ(flight.report.outcome, Outcome::kSuccess) << summary_table(flight.report);
  }
}

// Robot 1's goal lies inside a closed room.
TEST(Lockstep, SaysThatAGoalCannotBeReached) {
  TemporaryDirectory directory;
  World world = circle(2, 2.5, 0, 1);
  world.robots[0].mission = {{{0.4, 2.0, 1.0}}};
  world.robots[1].mission = {{{0.0, 0.0, 1.0}}};
  for (const double side : {-1.0, 1.0}) {
    world.walls.push_back({{side - 0.1, -1.1, 0}, {side + 0.1, 1.1, 4}});
    world.walls.push_back({{-1.1, side - 0.1, 0}, {1.1, side + 0.1, 4}});
  }
  FlightOptions options;
  options.time_limit_s = 5.0;
  const Flight flight(with_walls_in_file(world, directory.path()), options);
  EXPECT_EQ(flight.report.outcome, Outcome::kUnreachable) << summary_table(flight.report);
  EXPECT_EQ(flight.report.paper_outcome, Outcome::kDeadlock);
  EXPECT_FALSE(flight.report.robots[0].is_unreachable);
  EXPECT_TRUE(flight.report.robots[0].verdict.flight_time_s.has_value());
  EXPECT_TRUE(flight.report.robots[1].is_unreachable);
  EXPECT_NE(summary_table(flight.report).find("robot 1: no way leads to its goal"), std::string::npos);
}

TEST(Lockstep, TheFirstTouchTellsThePapersSplitOfFailures) {
  const Touch hit{1.0, 0, Counterpart::kObstacle, 3, -0.1, true}, flown_into{1.0, 0, Counterpart::kObstacle, 3, -0.1};
  const Touch met{1.0, 0, Counterpart::kRobot, 1, -0.1, true};
  EXPECT_EQ(paper_outcome_of(Outcome::kSuccess, {}), Outcome::kSuccess);
  EXPECT_EQ(paper_outcome_of(Outcome::kTimeout, {}), Outcome::kDeadlock);
  EXPECT_EQ(paper_outcome_of(Outcome::kCollision, {hit, flown_into}), Outcome::kDeadlock);
  EXPECT_EQ(paper_outcome_of(Outcome::kCollision, {flown_into, hit}), Outcome::kCollision);
  EXPECT_EQ(paper_outcome_of(Outcome::kCollision, {met}), Outcome::kCollision);
}

TEST(Lockstep, TimeLimitEndsTheRun) {
  FlightOptions options;
  options.time_limit_s = 1.0;
  const Flight flight(circle(2, 3.0, 0, 1), options);
  EXPECT_EQ(flight.report.outcome, Outcome::kTimeout);
  EXPECT_NEAR(flight.report.duration_s, 1.0, 1e-9);
  EXPECT_FALSE(flight.report.robots[0].verdict.flight_time_s);
  EXPECT_GT(flight.report.robots[0].verdict.path_length_m, 0.5);  // on its way
}

// Two cross each other's ways, slower where they shall be, and wait where they shall wait.
TEST(Lockstep, MissionsAreFlownFromGoalToGoal) {
  World world = circle(2, 2.0, 0, 1);
  world.robots[0].mission = {{{0, 1.5, 1}, 0.3, 0.5}, {{0, -1.5, 2}, 0.1, 2.0, 1s}, {world.robots[0].goal()}};
  world.robots[1].mission = {{{0, -1.5, 1}, 0.3}, {{0, 1.5, 2}, 0.5}, {world.robots[1].goal(), 0.2, 0.8}};
  const Flight flight(world);
  EXPECT_EQ(flight.report.outcome, Outcome::kSuccess) << summary_table(flight.report);
  expect_flyable(flight);
  const auto trace = read_trace(flight.directory / "trace.csv");
  for (const WorldRobot& robot : world.robots) {
    EXPECT_EQ(flight.report.robots[static_cast<std::size_t>(robot.id)].verdict.goals_reached, 3);
    MissionProgress progress;
    progress.fly(robot.mission);
    double waited_s = 0.0;
    for (const Row& row : trace.at(robot.id)) {
      progress.pass(Utime() + to_duration(row.t_s), {row.position, row.velocity, row.acceleration});
      EXPECT_LE(row.velocity.cwiseAbs().maxCoeff(), 1.01 * progress.waypoint().speed_mps) << row.t_s << " s";
      const bool is_there = (row.position - robot.mission[1].position).norm() <= robot.mission[1].tolerance_m;
      waited_s += progress.index() == 1 && is_there ? 0.01 : 0.0;
    }
    EXPECT_GE(waited_s + 0.02, to_seconds(robot.mission[1].wait));
    EXPECT_LE(waited_s, to_seconds(robot.mission[1].wait) + 0.5) << "it goes on";
  }
}

TEST(Lockstep, RobotsThatNeverHearEachOtherEndInADeadlock) {
  FlightOptions options;
  options.link.loss = 1.0;
  options.time_limit_s = 3.5;
  const Flight flight(circle(2, 3.0, 0, 1), options);
  EXPECT_EQ(flight.report.outcome, Outcome::kDeadlock) << summary_table(flight.report);
  for (const RobotReport& robot : flight.report.robots) {
    EXPECT_GT(robot.plans, 0);
    EXPECT_EQ(robot.verdict.path_length_m, 0.0);  // they hover where they promised to
  }
}

TEST(Lockstep, PlansThatComeTooLateAreBegunEarlier) {
  FlightOptions options;
  options.planner.lead_s = 0.005;  // less than planning and the way to the broadcast daemon take
  EXPECT_EQ(Flight(circle(2, 3.0, 0, 1), options).report.outcome, Outcome::kSuccess);
  options.link.delay_ms = 100;  // one way
  EXPECT_EQ(Flight(circle(2, 3.0, 0, 1), options).report.outcome, Outcome::kSuccess);
}

TEST(Lockstep, ProgressIsReportedTenTimesASecondAndMayEndTheRun) {
  std::vector<double> times;
  const World world = circle(2, 3.0, 0, 1);
  const RunReport report =
      run_lockstep(world, nullptr, {}, {}, nullptr, nullptr, [&](double t_s, const Simulation& simulation) {
        times.push_back(t_s);
        EXPECT_EQ(simulation.vehicles().size(), 2u);
        return t_s < 0.95;
      });
  ASSERT_EQ(times.size(), 11u);
  for (std::size_t i = 0; i < times.size(); ++i) EXPECT_NEAR(times[i], 0.1 * static_cast<double>(i), 1e-9);
  EXPECT_NEAR(report.duration_s, 1.0, 1e-9);
  EXPECT_EQ(report.outcome, Outcome::kTimeout);
}

// Keepers and cells: all arrive, with losses and crashes, nothing meets, and robots hear those nearby alone.
TEST(Lockstep, RobotsFlyInCells) {
  const World world = make_world(Task::kRandom, Environment::kEmpty, 0, 2,
                                 {.robots = 12, .space_m = {40, 12, 4}, .goals = 2, .hop_m = 6});
  FlightOptions options;
  options.cells_m = 8;
  options.link.loss = 0.1;
  options.link.delay_ms = 5;
  options.kills = parse_kills("broadcast:3@2,broadcast:5@2.5-4,planner:0@3,keeper@1.5-2");
  const Flight flight(world, options);
  EXPECT_EQ(flight.report.outcome, Outcome::kSuccess);
  EXPECT_EQ(flight.report.commit_conflicts, 0);
  EXPECT_GT(flight.report.commit.count, 12u);
  EXPECT_GT(flight.report.channels.at(channel::kCellRoster).messages, 100);
  EXPECT_GT(flight.report.channels.at(channel::kCellAnnouncement).messages, 1000);
  EXPECT_FALSE(flight.report.channels.contains(channel::kAnnouncement));
  const Flight again(world, options);
  EXPECT_EQ(read_text(flight.directory / "trace.csv"), read_text(again.directory / "trace.csv"));
  EXPECT_EQ(read_text(flight.directory / "swarm.lcm"), read_text(again.directory / "swarm.lcm"));
}

// Nobody was told before who flies. A robot that comes while the others are under way flies to its goals with them;
// one that leaves at once is no longer waited for two seconds later.
TEST(Lockstep, RobotsJoinAndLeaveOneLargeCellInFlight) {
  const World world = make_world(Task::kCircle, Environment::kEmpty, 0, 3, {.robots = 4, .circle_m = 5.0});
  FlightOptions options;
  options.cells_m = 1000;
  options.time_limit_s = 15.0;
  options.kills = parse_kills("broadcast:0@0.01-3,broadcast:1@1.5");
  const Flight flight(world, options);
  EXPECT_EQ(flight.report.commit_conflicts, 0);
  EXPECT_EQ(flight.report.forced_commits, 0);
  EXPECT_EQ(flight.report.touches.size(), 0u);
  std::map<int, int> goals;
  for (const RobotReport& robot : flight.report.robots) goals[robot.verdict.id] = robot.verdict.goals_reached;
  EXPECT_EQ(goals.at(0), 1) << "who joined";
  EXPECT_EQ(goals.at(2) + goals.at(3), 2) << "who stayed";
}

}  // namespace
}  // namespace swarm::test
