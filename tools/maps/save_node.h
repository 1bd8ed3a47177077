// Asks a perception daemon to write its map, and waits until it has.
#pragma once

#include <optional>

#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/receive.h"
#include "lcmtypes/bus/recurring.h"

namespace swarm {

class SaveNode : public Node {
 public:
  enum class Progress : std::uint8_t {
    kSilent,  // no perception daemon was heard
    kKeepsNone,
    kAsked,
    kNotWritten,  // its log says why
    kWritten,
  };

  // `boot`: grows at every start.
  SaveNode(int robot_id, std::int32_t boot) : robot_id_(robot_id), headers_(robot_id, boot) {}

  std::vector<Subscription> subscriptions() const override;
  void on_message(Utime now, BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes,
                  Outbox& outbox) override;
  Utime step(Utime now, Outbox& outbox) override;

  int robot_id() const { return robot_id_; }
  Progress progress() const { return progress_; }
  bool is_full() const { return is_full_; }  // not all that was seen is in the map

 private:
  int robot_id_;
  HeaderSource headers_;
  SequenceGate status_gate_;
  std::optional<std::int32_t> written_;  // maps, before it was asked
  bool is_full_ = false;
  Recurring asked_;
  Utime asked_since_{};
  Progress progress_ = Progress::kSilent;
};

}  // namespace swarm
