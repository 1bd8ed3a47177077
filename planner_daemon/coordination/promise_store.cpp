#include "planner_daemon/coordination/promise_store.h"

#include <fcntl.h>
#include <linux/magic.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <exception>
#include <fstream>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/codec.h"

namespace swarm {
namespace {

constexpr std::size_t kMaxPromise = 4096;  // bytes; an announcement of the largest roster has half of that

bool is_in_memory(int file) {
  struct statfs file_system {};
  return ::fstatfs(file, &file_system) == 0 && (file_system.f_type == TMPFS_MAGIC || file_system.f_type == RAMFS_MAGIC);
}

}  // namespace

FilePromiseStore::FilePromiseStore(const std::filesystem::path& path) : paths_{path, path.string() + ".copy"} {
  const std::string lock = path.string() + ".lock";
  lock_ = ::open(lock.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NONBLOCK, 0600);
  if (lock_ >= 0 && ::flock(lock_, LOCK_EX | LOCK_NB) == 0) {
    if (!is_in_memory(lock_)) {
      spdlog::warn("--state-dir {}: is on a disk; setpoints wait where that one is busy, in memory (/run) they do not",
                   path.parent_path().string());
    }
    return;
  }
  const std::string reason =
      errno == EWOULDBLOCK ? "another broadcast_daemon of this robot runs here" : std::strerror(errno);
  if (lock_ >= 0) ::close(lock_);
  throw std::runtime_error(lock + ": cannot be locked: " + reason);
}

FilePromiseStore::~FilePromiseStore() {
  ::close(lock_);
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

KeptPromise load_promise(PromiseStore& store, int robot_id, std::int32_t first_boot) {
  std::optional<sogm_swarm::announcement_t> newest;
  for (const std::vector<std::uint8_t>& copy : store.load()) {
    sogm_swarm::announcement_t kept;
    if (const Refusal refusal = decode(copy, &kept); refusal != Refusal::kNone) {
      spdlog::error("a copy of what robot {} promised is damaged ({}) and passed over", robot_id, to_string(refusal));
    } else if (kept.header.robot_id != robot_id) {
      spdlog::error("a copy of what robot {} promised is robot {}'s and passed over", robot_id, kept.header.robot_id);
    } else if (!newest ||
               std::pair(kept.header.boot, kept.header.seq) > std::pair(newest->header.boot, newest->header.seq)) {
      newest = kept;
    }
  }
  if (!newest || newest->header.boot == std::numeric_limits<std::int32_t>::max()) return {first_boot, {}, 0, {}};
  return {newest->header.boot + 1, motion_of(*newest), newest->forced_seq,
          to_utime(newest->header.utime)};  // what was pending nobody can have committed
}

}  // namespace swarm
