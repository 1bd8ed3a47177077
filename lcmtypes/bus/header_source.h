// Fills message headers: one sequence per channel.
#pragma once

#include <cstdint>

#include "lcmtypes/bus/time.h"
#include "sogm_swarm/header_t.hpp"

namespace swarm {

class HeaderSource {
 public:
  // `boot` must grow at every start of the sender: new_boot() on onboard buses.
  HeaderSource(int robot_id, std::int32_t boot) : robot_id_(robot_id), boot_(boot) {}

  sogm_swarm::header_t next(Utime utime) {
    sogm_swarm::header_t header{};
    header.schema_version = sogm_swarm::header_t::kSchemaVersion;
    header.robot_id = static_cast<std::int16_t>(robot_id_);
    header.boot = boot_;
    header.seq = seq_++;
    header.utime = to_us(utime);
    return header;
  }

 private:
  int robot_id_;
  std::int32_t boot_;
  std::int64_t seq_ = 0;
};

}  // namespace swarm
