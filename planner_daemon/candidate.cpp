#include "planner_daemon/candidate.h"

namespace swarm {
namespace {

constexpr double kKeepBonus_s = 0.05;  // of the motion already flown where the search got stuck
constexpr double kGraze = 0.2;         // a violation so small, or so far ahead, is not worth giving up a plan
constexpr double kTie = 1e-9;          // in danger, of two that violate alike the own motion stays
constexpr double kWorthwhile = 3.0;    // an escape must violate so much less to be worth its rough flight

}  // namespace

// An escape flies roughly, so it must violate much less than what was planned. The own motion stays where it violates
// less than that. In danger nothing else counts. Else a path that is found to graze something between the search's
// samples counts as free; and a search that got stuck is not followed where the own motion, no less free, ends nearer
// to the goal: an earlier search knew better.
Choice choose(std::span<const Candidate> candidates, const Situation& situation) {
  Choice choice{&candidates.front(), true};
  for (const Candidate& other : candidates) {
    if (other.kind == Candidate::Kind::kEscape && other.violation_cost + kWorthwhile < choice.planned->violation_cost)
      choice.planned = &other;
  }
  const double graze = situation.in_danger ? -kTie : kGraze;
  for (const Candidate& own : candidates) {
    if (own.kind != Candidate::Kind::kOwn) continue;
    const bool is_nearer = situation.is_stuck && !situation.in_danger &&
                           own.violation_cost <= choice.planned->violation_cost &&
                           own.time_to_goal_s < choice.planned->time_to_goal_s + kKeepBonus_s;
    choice.fly = own.violation_cost + graze >= choice.planned->violation_cost && !is_nearer;
  }
  return choice;
}

}  // namespace swarm
