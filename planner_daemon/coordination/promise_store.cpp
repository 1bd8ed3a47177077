#include "planner_daemon/coordination/promise_store.h"

#include <exception>
#include <fstream>
#include <iterator>
#include <limits>
#include <string_view>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/codec.h"

namespace swarm {

std::vector<std::uint8_t> FilePromiseStore::load() {
  std::ifstream in(path_, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

bool FilePromiseStore::save(std::span<const std::uint8_t> bytes) try {
  write_file(path_, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  return true;
} catch (const std::exception&) {
  return false;
}

KeptPromise load_promise(PromiseStore& store, int robot_id, std::int32_t first_boot) {
  sogm_swarm::announcement_t kept;
  if (decode(store.load(), &kept) != Refusal::kNone || kept.header.robot_id != robot_id ||
      kept.header.boot == std::numeric_limits<std::int32_t>::max())
    return {first_boot, {}, 0, {}};
  return {kept.header.boot + 1, motion_of(kept), kept.forced_seq,
          to_utime(kept.header.utime)};  // what was pending nobody can have committed
}

}  // namespace swarm
