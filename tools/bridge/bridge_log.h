// What the bridge tells its operator: changes as they come, and every ten seconds where things stand.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "lcmtypes/bus/recurring.h"
#include "tools/bridge/bridge_node.h"
#include "tools/bridge/controller_link.h"
#include "tools/bridge/log_line.h"

namespace swarm {

class BridgeLog {
 public:
  // What there is to say at `now`. To be called some ten times a second.
  std::vector<LogLine> update(Utime now, const BridgeReport& bridge, const LinkReport& link,
                              const mavlink::Parser& parser);

 private:
  struct Seen {
    bool connected = false, heard = false, armed = false, version_1 = false, off = false, blind = false;
    std::string peer, mode;
    LedBy led_by = LedBy::kNone;
    std::int64_t restarts = 0, lost = 0;
    std::optional<std::uint16_t> told;
    std::optional<std::uint8_t> answered;
  };

  Seen seen_;
  std::optional<Recurring> summary_;
};

}  // namespace swarm
