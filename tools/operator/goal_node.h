// Tells one robot where to go or what to do, until it says that it heard it, and looks whether it arrives.
#pragma once

#include <optional>

#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/receive.h"
#include "lcmtypes/bus/recurring.h"
#include "tools/operator/goal_order.h"

namespace swarm {

class GoalNode : public Node {
 public:
  enum class Progress : std::uint8_t {
    kSilent,       // nothing was heard of the robot that answers it
    kRefused,      // the order, see flight()
    kOnGround,     // it was sent somewhere, and stands
    kWaits,        // the planner knows the goal, and waits for something else, see planner_state()
    kUnreachable,  // no way leads there, by all that is known to stand still
    kFlies,        // or does what was ordered
    kArrived,      // within the tolerance of the last place, after all others; or what was ordered is done
  };

  // `boot`: grows at every start.
  GoalNode(GoalOrder order, std::int32_t boot)
      : order_(std::move(order)), boot_(boot), headers_(order_.robot_id, boot), order_headers_(order_.robot_id, boot) {}

  std::vector<Subscription> subscriptions() const override;
  void on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox& outbox) override;
  Utime step(Utime now, Outbox& outbox) override;

  const GoalOrder& order() const { return order_; }
  Progress progress() const;
  int waypoint() const { return status_ ? status_->waypoint : 0; }  // that it flies to
  // Of the robot, as it was heard last.
  const std::optional<sogm_swarm::flight_status_t>& flight() const { return flight_; }
  std::int16_t planner_state() const { return status_ ? status_->state : std::int16_t{-1}; }

 private:
  void order(Utime now, std::int16_t order, Outbox& outbox);
  Progress progress_of_order() const;

  GoalOrder order_;
  std::int32_t boot_;
  HeaderSource headers_, order_headers_;
  std::optional<Utime> told_;  // first
  Recurring told_again_;
  int answers_ = 0;                                     // statuses since
  std::optional<sogm_swarm::planner_status_t> status_;  // the newest of them
  std::optional<Eigen::Vector3d> position_;
  std::optional<sogm_swarm::flight_status_t> flight_;
  bool flight_answers_ = false;  // it knows an order of ours
  SequenceGate state_gate_, status_gate_, flight_gate_;
};

}  // namespace swarm
