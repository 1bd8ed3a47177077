// What a broadcast daemon must not forget when it crashes: its newest binding announcement, and where it was in its
// flight.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "lcmtypes/bus/cell_messages.h"
#include "lcmtypes/bus/lock_file.h"
#include "planner_daemon/trajectory/motion.h"
#include "sogm_swarm/flight_status_t.hpp"

namespace swarm {

class PromiseStore {
 public:
  using Copies = std::vector<std::vector<std::uint8_t>>;

  virtual ~PromiseStore() = default;
  // The copies of what was saved last that can be read: all of the same, unless saving was interrupted or one of them
  // was damaged since.
  virtual Copies load() = 0;
  // False when it could not be saved at all; what was saved before is then still there.
  [[nodiscard]] virtual bool save(std::span<const std::uint8_t> bytes) = 0;
};

// For simulated robots: outlives the node, not the process.
class MemoryPromiseStore : public PromiseStore {
 public:
  Copies load() override { return Copies(bytes_.empty() ? 0 : 1, bytes_); }
  bool save(std::span<const std::uint8_t> bytes) override {
    bytes_.assign(bytes.begin(), bytes.end());
    return true;
  }

 private:
  std::vector<std::uint8_t> bytes_;
};

// Two files, PATH and PATH.copy, each replaced as a whole: a damaged one leaves the other. They belong in memory
// (/run), so that they survive the daemon but not the computer's power: who saves on a disk waits for it at every
// commit, seconds long where others write much to it, with setpoints that wait as well; and a robot whose computer lost
// power flies no trajectory any more. Nobody else can have it at the same time: PATH.lock is locked until the store, or
// its process, is gone.
class FilePromiseStore : public PromiseStore {
 public:
  // Throws std::runtime_error with path and reason: another has it, or it cannot be locked. Logs that it is on a disk.
  explicit FilePromiseStore(const std::filesystem::path& path);

  // Logs what is there and is no promise file.
  Copies load() override;
  bool save(std::span<const std::uint8_t> bytes) override;

 private:
  std::array<std::filesystem::path, 2> paths_;
  LockFile lock_;
};

// How a robot starts: `boot` is higher than that of the start whose promise was kept; `first_boot` where none was.
struct KeptPromise {
  std::int32_t boot = 0;
  std::optional<Motion> motion;
  std::int32_t forced_seq = 0;  // newest trajectory that was forced
  Utime utime{};                // when it was kept
  std::optional<sogm_swarm::flight_status_t> flight = {};
  std::int32_t roster_crc = 0;  // and whom of that roster it had answered, and given up
  std::vector<sogm_swarm::ack_t> acks = {};
  std::map<Cell, CellAnnouncement::Standing> cells = {};  // or which cells it had to do with
};
// What is kept: an announcement, in cells one of those, and a flight status, each with the same header. Nothing: it has
// to do with too many cells (cell_announcement_t::kMaxCells).
std::vector<std::uint8_t> promise_bytes(CellAnnouncement promise, const sogm_swarm::flight_status_t& flight);
// Of the copies that are whole the newest counts; what is damaged, or another robot's, is logged.
KeptPromise load_promise(PromiseStore& store, int robot_id, std::int32_t first_boot);

}  // namespace swarm
