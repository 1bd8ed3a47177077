// Which of what could be flown is flown.
#include "planner_daemon/candidate.h"

#include <gtest/gtest.h>

#include <vector>

namespace swarm {
namespace {

using Kind = Candidate::Kind;

constexpr Situation kFree{}, kStuck{false, true}, kDanger{true, false}, kStuckInDanger{true, true};

Candidate candidate(Kind kind, double violation_cost, double time_to_goal_s = 0.0) {
  return {kind, Trajectory(), violation_cost, time_to_goal_s};
}

// What flies: kOwn when nothing new does.
Kind flown(const std::vector<Candidate>& candidates, const Situation& situation) {
  const Choice choice = choose(candidates, situation);
  return choice.fly ? choice.planned->kind : Kind::kOwn;
}

TEST(Choose, WhatWasPlannedWhereNothingElseIsThere) {
  EXPECT_EQ(flown({candidate(Kind::kSmooth, 0)}, kFree), Kind::kSmooth);
  EXPECT_EQ(flown({candidate(Kind::kBlocked, 9)}, kStuckInDanger), Kind::kBlocked);
}

TEST(Choose, AnEscapeThatViolatesMuchLess) {
  const auto with_escape = [](double violation_cost) {
    return std::vector{candidate(Kind::kBlocked, 5), candidate(Kind::kEscape, violation_cost),
                       candidate(Kind::kOwn, 9)};
  };
  EXPECT_EQ(flown(with_escape(1.9), kDanger), Kind::kEscape);
  EXPECT_EQ(flown(with_escape(2.1), kDanger), Kind::kBlocked);
}

TEST(Choose, TheOwnMotionWhereItViolatesLess) {
  const auto with_own = [](double violation_cost) {
    return std::vector{candidate(Kind::kBlocked, 5), candidate(Kind::kOwn, violation_cost)};
  };
  EXPECT_EQ(flown(with_own(4.9), kDanger), Kind::kOwn);
  EXPECT_EQ(flown(with_own(5.0), kDanger), Kind::kOwn) << "of two that violate alike";
  EXPECT_EQ(flown(with_own(5.1), kDanger), Kind::kBlocked);
  EXPECT_EQ(flown(with_own(4.7), kFree), Kind::kOwn);
  EXPECT_EQ(flown(with_own(4.9), kFree), Kind::kBlocked) << "a plan that grazes counts as free";
}

TEST(Choose, TheOwnMotionThatEndsNearerThanASearchThatGotStuck) {
  const auto ending = [](double own_s, double own_violation) {
    return std::vector{candidate(Kind::kSmooth, 0, 1.0), candidate(Kind::kOwn, own_violation, own_s)};
  };
  EXPECT_EQ(flown(ending(1.04, 0), kStuck), Kind::kOwn);
  EXPECT_EQ(flown(ending(1.06, 0), kStuck), Kind::kSmooth);
  EXPECT_EQ(flown(ending(1.04, 0.1), kStuck), Kind::kSmooth) << "it is less free";
  EXPECT_EQ(flown(ending(0.5, 0), kFree), Kind::kSmooth) << "the search did not get stuck";
  const std::vector both = {candidate(Kind::kBlocked, 0.1, 1.0), candidate(Kind::kOwn, 0.1 + 1e-6, 0.5)};
  EXPECT_EQ(flown(both, kStuckInDanger), Kind::kBlocked) << "in danger nothing else counts";
}

}  // namespace
}  // namespace swarm
