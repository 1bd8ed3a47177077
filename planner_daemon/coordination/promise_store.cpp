#include "planner_daemon/coordination/promise_store.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <exception>
#include <fstream>
#include <limits>
#include <optional>
#include <utility>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/packed_cell_messages.h"

namespace swarm {
namespace {

constexpr std::size_t kMaxPromise = 4096;  // bytes; an announcement of the largest roster has half of that

// Its announcement and its flight status, which is as long as the fixed part of one.
std::pair<std::span<const std::uint8_t>, std::span<const std::uint8_t>> split_promise(
    std::span<const std::uint8_t> bytes) {
  static const std::size_t flight_size = [] {
    std::vector<std::uint8_t> encoded;
    encode(sogm_swarm::flight_status_t{}, &encoded);
    return encoded.size();
  }();
  const std::size_t size = std::min(flight_size, bytes.size());
  return {bytes.first(bytes.size() - size), bytes.last(size)};
}

Refusal read_promise(std::span<const std::uint8_t> bytes, CellAnnouncement* promise) {
  sogm_swarm::cell_announcement_t in_cells;
  if (decode(bytes, &in_cells) == Refusal::kNone) return unpack(in_cells, promise);
  return decode(bytes, &promise->robot);
}

}  // namespace

FilePromiseStore::FilePromiseStore(const std::filesystem::path& path)
    : paths_{path, path.string() + ".copy"},
      lock_(path.string() + ".lock", "another broadcast_daemon of this robot runs here") {
  if (lock_.is_in_memory()) return;
  spdlog::warn("--state-dir {}: is on a disk; setpoints wait where that one is busy, in memory (/run) they do not",
               path.parent_path().string());
}

PromiseStore::Copies FilePromiseStore::load() {
  Copies copies;
  for (const std::filesystem::path& path : paths_) {
    std::error_code error;
    if (!std::filesystem::exists(path, error)) continue;
    std::vector<std::uint8_t> bytes(kMaxPromise + 1);
    if (std::filesystem::is_regular_file(path, error)) {  // a pipe would be waited for
      std::ifstream in(path, std::ios::binary);
      in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
      bytes.resize(static_cast<std::size_t>(in.gcount()));
    }
    if (bytes.empty() || bytes.size() > kMaxPromise) {
      spdlog::error("{}: must be a file of 1 to {} bytes; what was promised is not read from it", path.string(),
                    kMaxPromise);
    } else {
      copies.push_back(std::move(bytes));
    }
  }
  return copies;
}

bool FilePromiseStore::save(std::span<const std::uint8_t> bytes) {
  bool is_saved = false;
  for (const std::filesystem::path& path : paths_) {
    try {
      write_file(path, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
      is_saved = true;
    } catch (const std::exception&) {  // the other one may do
    }
  }
  return is_saved;
}

std::vector<std::uint8_t> promise_bytes(CellAnnouncement promise, const sogm_swarm::flight_status_t& flight) {
  std::vector<std::uint8_t> bytes, more;
  sogm_swarm::flight_status_t with_header = flight;
  with_header.header = promise.robot.header;
  if (promise.cells.empty()) {
    encode(promise.robot, &bytes);
  } else {
    const auto packed = pack(&promise);
    if (!packed) return {};
    encode(*packed, &bytes);
  }
  encode(with_header, &more);
  bytes.insert(bytes.end(), more.begin(), more.end());
  return bytes;
}

KeptPromise load_promise(PromiseStore& store, int robot_id, std::int32_t first_boot) {
  std::optional<CellAnnouncement> newest;
  std::optional<sogm_swarm::flight_status_t> flight;
  for (const std::vector<std::uint8_t>& copy : store.load()) {
    const auto [promise_part, flight_part] = split_promise(copy);
    CellAnnouncement promise;
    const sogm_swarm::announcement_t& kept = promise.robot;
    sogm_swarm::flight_status_t kept_flight;
    Refusal refusal = read_promise(promise_part, &promise);
    if (refusal == Refusal::kNone) refusal = decode(flight_part, &kept_flight);
    if (refusal != Refusal::kNone) {
      spdlog::error("a copy of what robot {} promised is damaged ({}) and passed over", robot_id, to_string(refusal));
    } else if (kept.header.robot_id != robot_id) {
      spdlog::error("a copy of what robot {} promised is robot {}'s and passed over", robot_id, kept.header.robot_id);
    } else if (!newest || std::pair(kept.header.boot, kept.header.seq) >
                              std::pair(newest->robot.header.boot, newest->robot.header.seq)) {
      newest = promise;
      flight = kept_flight;
    }
  }
  if (!newest || newest->robot.header.boot == std::numeric_limits<std::int32_t>::max())
    return {first_boot, {}, 0, {}, {}};
  const sogm_swarm::announcement_t& kept = newest->robot;
  return {kept.header.boot + 1,
          motion_of(kept),  // what was pending nobody can have committed
          kept.forced_seq,      to_utime(kept.header.utime), flight, kept.roster_crc, kept.acks, newest->cells};
}

}  // namespace swarm
