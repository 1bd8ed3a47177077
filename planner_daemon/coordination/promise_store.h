// What a broadcast daemon must not forget when it crashes: its newest binding announcement.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "planner_daemon/trajectory/motion.h"

namespace swarm {

class PromiseStore {
 public:
  virtual ~PromiseStore() = default;
  // What was saved last; empty when nothing was, or when it cannot be read.
  virtual std::vector<std::uint8_t> load() = 0;
  // False when it could not be saved; what was saved before is then still there.
  [[nodiscard]] virtual bool save(std::span<const std::uint8_t> bytes) = 0;
};

// For simulated robots: outlives the node, not the process.
class MemoryPromiseStore : public PromiseStore {
 public:
  std::vector<std::uint8_t> load() override { return bytes_; }
  bool save(std::span<const std::uint8_t> bytes) override {
    bytes_.assign(bytes.begin(), bytes.end());
    return true;
  }

 private:
  std::vector<std::uint8_t> bytes_;
};

// One file, replaced as a whole. It survives the daemon, not necessarily the computer's power: waiting for the disk at
// every commit would hold up the setpoints, and a robot whose computer lost power flies no trajectory any more. Nobody
// else can have it at the same time: PATH.lock is locked until the store, or its process, is gone.
class FilePromiseStore : public PromiseStore {
 public:
  // Throws std::runtime_error with path and reason: another has it, or it cannot be locked.
  explicit FilePromiseStore(std::filesystem::path path);
  ~FilePromiseStore() override;
  FilePromiseStore(const FilePromiseStore&) = delete;
  FilePromiseStore& operator=(const FilePromiseStore&) = delete;

  std::vector<std::uint8_t> load() override;
  bool save(std::span<const std::uint8_t> bytes) override;

 private:
  std::filesystem::path path_;
  int lock_ = -1;
};

// How a robot starts: `boot` is higher than that of the start whose promise was kept; `first_boot` where none was.
struct KeptPromise {
  std::int32_t boot = 0;
  std::optional<Motion> motion;
  std::int32_t forced_seq = 0;  // newest trajectory that was forced
  Utime utime{};                // when it was kept
};
KeptPromise load_promise(PromiseStore& store, int robot_id, std::int32_t first_boot);

}  // namespace swarm
