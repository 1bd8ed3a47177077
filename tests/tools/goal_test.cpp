// What an operator writes to send robots somewhere, and the conversation with the planner that follows.
#include <gtest/gtest.h>

#include "lcmtypes/bus/channels.h"
#include "tests/support/harness.h"
#include "tools/operator/goal_node.h"

namespace swarm::test {
namespace {

using sogm_swarm::flight_status_t;
using sogm_swarm::goal_t;
using sogm_swarm::order_t;
using sogm_swarm::planner_status_t;
using Progress = GoalNode::Progress;

std::string refusal_of(const std::vector<std::string>& words, const GoalOptions& options = {}) {
  try {
    read_orders(words, options);
    return "";
  } catch (const OptionError& error) {
    return error.what();
  }
}

TEST(GoalOrder, OnePlaceOfOneRobot) {
  const auto orders = read_orders({"7", "-3", "2.5", "1e0"}, {});
  ASSERT_EQ(orders.size(), 1u);
  EXPECT_EQ(orders[0].robot_id, 7);
  EXPECT_EQ(orders[0].mission, Mission(1, Waypoint{.position = {-3, 2.5, 1}}));
}

TEST(GoalOrder, PlacesOfSeveralRobots) {
  const GoalOptions options{.tolerance_m = 0.3, .speed_mps = 0.5, .wait_s = 2.0, .times = 2};
  const auto orders =
      read_orders({"0", "1,2,3", "-4,.5,6", "12,4", "take-off", "3", "0,0,1", "5,6", "without", "4"}, options);
  ASSERT_EQ(orders.size(), 6u);
  EXPECT_EQ(orders[5].robot_id, 6);
  EXPECT_EQ(orders[5].order, order_t::kWithout);
  EXPECT_EQ(orders[5].other_id, 4);
  const auto at = [](double x, double y, double z) {
    return Waypoint{.position = {x, y, z}, .tolerance_m = 0.3, .speed_mps = 0.5, .wait = 2s};
  };
  EXPECT_EQ(orders[0].robot_id, 0);
  EXPECT_EQ(orders[0].mission, (Mission{at(1, 2, 3), at(-4, 0.5, 6), at(1, 2, 3), at(-4, 0.5, 6)}));
  EXPECT_EQ(orders[1].robot_id, 12);
  EXPECT_TRUE(orders[1].mission.empty());
  EXPECT_EQ(orders[1].order, order_t::kTakeOff);
  EXPECT_EQ(orders[1].height_m, 1.5);
  EXPECT_EQ(orders[2].robot_id, 4);
  EXPECT_EQ(orders[2].order, order_t::kTakeOff);
  EXPECT_EQ(orders[3].order, std::nullopt);
  EXPECT_EQ(orders[3].mission, (Mission{at(0, 0, 1), at(0, 0, 1)}));
}

TEST(GoalOrder, WhatMakesNoSenseIsNamed) {
  EXPECT_EQ(refusal_of({}).find("nothing to do: must be ROBOT X Y Z"), 0u);
  EXPECT_EQ(refusal_of({"1,2", "0,0,1"}), "robots '1,2': must not go to the same place");
  EXPECT_EQ(refusal_of({"1,1", "land"}), "robot '1': must be named once");
  EXPECT_EQ(refusal_of({"1", "jump"}).find("robot '1' has no place: must be ROBOT X Y Z"), 0u);
  EXPECT_EQ(refusal_of({"x", "1,2,3"}), "robot 'x': must be an id within [0, 32767]");
  EXPECT_EQ(refusal_of({"32768", "hold"}), "robot '32768': must be an id within [0, 32767]");
  EXPECT_EQ(refusal_of({"1", "hold", "1", "1,2,3"}), "robot '1': must be named once");
  EXPECT_EQ(refusal_of({"1"}).find("robot '1' has no place: must be ROBOT X Y Z"), 0u);
  EXPECT_EQ(refusal_of({"1", "2", "3"}).find("robot '1' has no place"), 0u);
  EXPECT_EQ(refusal_of({"1", "2", "3", "4", "5"}).find("robot '1' has no place"), 0u);
  for (const char* place :
       {"1,2", "1,2,3,4", "1,2,", "1,2,x", "1,2,3m", "1,2,nan", "1,2,inf", "1,2,--3", "1,2,-", "1,2,100001"}) {
    EXPECT_EQ(refusal_of({"1", place}),
              "place '" + std::string(place) + "': must be X,Y,Z, each within [-100000, 100000] m");
  }
  EXPECT_EQ(refusal_of({"1", "2", "3", "z"}), "place '2,3,z': must be X,Y,Z, each within [-100000, 100000] m");
  EXPECT_EQ(refusal_of({"1", "2,3,4", "hold"}),
            "robot '1' has no place: must be ROBOT X Y Z, or for each robot ROBOT X,Y,Z [X,Y,Z...] or ROBOT[,ROBOT...] "
            "ORDER, which is take-off, hold, fly, home, land, emergency or without OTHER");
  EXPECT_EQ(refusal_of({"0,1", "without"}).find("robots '0,1' without whom: must be ROBOT X Y Z"), 0u);
  EXPECT_EQ(refusal_of({"0,1", "without", "1"}), "robot '1': cannot go on without itself");
  EXPECT_EQ(refusal_of({"0", "without", "far"}), "robot 'far': must be an id within [0, 32767]");
  EXPECT_EQ(refusal_of({"1", "1,2,3", "4,5,6"}, {.times = 501}), "robot '1': 1002 places; at most 1000");
}

class GoalNodeTest : public testing::Test {
 protected:
  using Operator = Bench<GoalNode>;

  static GoalOrder order(const std::vector<std::string>& words) { return read_orders(words, {}).at(0); }
  void hear_status(Operator& told, std::int16_t state, int waypoint = 0, int robot = 5) {
    planner_status_t status{};
    status.header = make_header(robot, 1, next_++, told.now);
    status.state = state;
    status.waypoint = waypoint;
    told.send(channel::kPlannerStatus, status);
  }
  void hear_flight(Operator& told, std::int16_t state, std::int32_t order_boot,
                   std::int16_t verdict = flight_status_t::kAccepted) {
    flight_status_t status{};
    status.header = make_header(5, 1, next_++, told.now);
    status.state = state;
    status.order_boot = order_boot;
    status.verdict = verdict;
    told.send(channel::kFlightStatus, status);
  }
  void hear_state(Operator& told, const Eigen::Vector3d& position, int robot = 5) {
    told.send(channel::kRobotState, state_at(robot, position, next_++, told.now));
  }

 private:
  std::int64_t next_ = 0;
};

TEST_F(GoalNodeTest, TellsAgainAndAgainUntilItIsThere) {
  Operator told(order({"5", "1,0,1", "2,0,1"}), 9);
  EXPECT_EQ(told.out.count(channel::kGoal), 1);
  told.run_for(1.05);
  EXPECT_EQ(told.out.count(channel::kGoal), 6);
  const goal_t goal = told.out.newest<goal_t>(channel::kGoal);
  EXPECT_EQ(goal.header.robot_id, 5);
  EXPECT_EQ(mission_of(goal), told.node.order().mission);
  EXPECT_EQ(told.node.progress(), Progress::kSilent);
  hear_status(told, planner_status_t::kPlanning, 0, 4);  // another robot's
  EXPECT_EQ(told.node.progress(), Progress::kSilent);
  hear_status(told, planner_status_t::kPlanning);
  EXPECT_EQ(told.node.progress(), Progress::kSilent) << "it may have been made before the goal was read";
  hear_status(told, planner_status_t::kStaleMap);
  EXPECT_EQ(told.node.progress(), Progress::kWaits);
  hear_status(told, planner_status_t::kUnreachable);
  EXPECT_EQ(told.node.progress(), Progress::kUnreachable);
  hear_state(told, {2, 0, 1});
  hear_status(told, planner_status_t::kPlanning);
  EXPECT_EQ(told.node.progress(), Progress::kFlies) << "it is at the last place, but was not at the first yet";
  hear_status(told, planner_status_t::kPlanning, 1);
  EXPECT_EQ(told.node.waypoint(), 1);
  EXPECT_EQ(told.node.progress(), Progress::kArrived);
  hear_state(told, {2.11, 0, 1});
  EXPECT_EQ(told.node.progress(), Progress::kFlies);
}

// What the planner said before it can have heard the goal is about another one.
TEST_F(GoalNodeTest, OldStatusesAreNoAnswer) {
  Operator told(order({"5", "1,0,1"}), 9);
  told.run_for(0.01);
  for (int i = 0; i < 3; ++i) hear_status(told, planner_status_t::kPlanning);
  EXPECT_EQ(told.node.progress(), Progress::kSilent);
  told.run_for(0.03);
  hear_status(told, planner_status_t::kPlanning);
  hear_status(told, planner_status_t::kPlanning);
  EXPECT_EQ(told.node.progress(), Progress::kFlies);
}

TEST_F(GoalNodeTest, OrdersUntilItIsKnownAndLooksForItsEnd) {
  Operator told(order({"5", "land"}), 9);
  told.run_for(0.5);
  EXPECT_EQ(told.out.count(channel::kFlightOrder), 3);
  EXPECT_EQ(told.out.count(channel::kGoal), 0);
  EXPECT_EQ(told.out.newest<order_t>(channel::kFlightOrder).order, order_t::kLand);
  hear_flight(told, flight_status_t::kFlying, -1);
  EXPECT_EQ(told.node.progress(), Progress::kSilent) << "it does not know of the order";
  hear_flight(told, flight_status_t::kLanding, 9);
  EXPECT_EQ(told.node.progress(), Progress::kFlies);
  told.run_for(1.0);
  EXPECT_EQ(told.out.count(channel::kFlightOrder), 3) << "it knows";
  hear_flight(told, flight_status_t::kOnGround, 9);
  EXPECT_EQ(told.node.progress(), Progress::kArrived);
}

TEST_F(GoalNodeTest, WithoutAnotherOneIsDoneOnceItIsKnown) {
  Operator told(order({"5", "without", "7"}), 9);
  EXPECT_EQ(told.out.newest<order_t>(channel::kFlightOrder).other_id, 7);
  hear_flight(told, flight_status_t::kFlying, -1);
  EXPECT_EQ(told.node.progress(), Progress::kSilent);
  hear_flight(told, flight_status_t::kFlying, 9);
  EXPECT_EQ(told.node.progress(), Progress::kArrived);
  hear_flight(told, flight_status_t::kFlying, 9, flight_status_t::kNotNow);
  EXPECT_EQ(told.node.progress(), Progress::kRefused);
}

TEST_F(GoalNodeTest, WhatIsNotObeyedIsSaid) {
  Operator told(order({"5", "take-off"}), 9);
  EXPECT_EQ(told.out.newest<order_t>(channel::kFlightOrder).height, 1.5);
  hear_flight(told, flight_status_t::kOnGround, 9, flight_status_t::kNoVehicle);
  EXPECT_EQ(told.node.progress(), Progress::kRefused);
  Operator other(order({"5", "take-off"}), 9);
  hear_flight(other, flight_status_t::kTakeOff, 9);
  EXPECT_EQ(other.node.progress(), Progress::kFlies);
  hear_flight(other, flight_status_t::kOnGround, 9);
  EXPECT_EQ(other.node.progress(), Progress::kRefused) << "it gave up";
}

TEST_F(GoalNodeTest, WhoIsSentSomewhereFliesThere) {
  Operator told(order({"5", "1,0,1"}), 9);
  hear_flight(told, flight_status_t::kOnGround, -1);
  EXPECT_EQ(told.node.progress(), Progress::kOnGround);
  told.run_for(1.0);
  EXPECT_EQ(told.out.count(channel::kFlightOrder), 0) << "nobody takes off by it";
  hear_flight(told, flight_status_t::kHold, -1);
  told.run_for(0.3);
  ASSERT_GE(told.out.count(channel::kFlightOrder), 1);
  EXPECT_EQ(told.out.newest<order_t>(channel::kFlightOrder).order, order_t::kFly);
  hear_flight(told, flight_status_t::kFlying, 9);
  EXPECT_EQ(told.node.progress(), Progress::kSilent) << "its planner has not answered";
}

}  // namespace
}  // namespace swarm::test
