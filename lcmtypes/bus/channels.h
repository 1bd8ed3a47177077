// Buses and the channels on them, from message_list.h. See lcmtypes/README.md for types, sizes and rates.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "lcmtypes/bus/message_list.h"

namespace swarm {

// The onboard bus never leaves the robot; the swarm bus connects the robots.
enum class BusId : std::uint8_t { kOnboard, kSwarm };

struct Channel {
  const char* name;
  BusId bus;
};

#define SWARM_CHANNELS_OF(type, channels, ...) channels

namespace channel {
#define SWARM_ON(constant, text, bus) inline constexpr char constant[] = text;
SWARM_MESSAGES(SWARM_CHANNELS_OF)
#undef SWARM_ON
}  // namespace channel

#define SWARM_ON(constant, text, bus) Channel{text, BusId::bus},
inline constexpr Channel kChannels[] = {SWARM_MESSAGES(SWARM_CHANNELS_OF)};
#undef SWARM_ON

#undef SWARM_CHANNELS_OF

// A channel's name without its cell, if it has one; see cell_channels.h.
inline constexpr std::string_view kCellPrefix = "_at_";
inline std::string_view kind_of(std::string_view channel) {
  return channel.substr(0, channel.find(kCellPrefix));
}

// Names of all channels of a bus.
inline std::vector<const char*> channels_of(BusId bus) {
  std::vector<const char*> names;
  for (const Channel& channel : kChannels) {
    if (channel.bus == bus) names.push_back(channel.name);
  }
  return names;
}

}  // namespace swarm
