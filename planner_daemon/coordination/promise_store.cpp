#include "planner_daemon/coordination/promise_store.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <exception>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>
#include <string_view>

#include "lcmtypes/bus/atomic_file.h"
#include "lcmtypes/bus/codec.h"

namespace swarm {
namespace {

constexpr std::size_t kMaxPromise = 4096;  // bytes; an announcement of the largest roster has half of that

}  // namespace

FilePromiseStore::FilePromiseStore(std::filesystem::path path) : path_(std::move(path)) {
  const std::string lock = path_.string() + ".lock";
  lock_ = ::open(lock.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NONBLOCK, 0600);
  if (lock_ >= 0 && ::flock(lock_, LOCK_EX | LOCK_NB) == 0) return;
  const std::string reason =
      errno == EWOULDBLOCK ? "another broadcast_daemon of this robot runs here" : std::strerror(errno);
  if (lock_ >= 0) ::close(lock_);
  throw std::runtime_error(lock + ": cannot be locked: " + reason);
}

FilePromiseStore::~FilePromiseStore() {
  ::close(lock_);
}

std::vector<std::uint8_t> FilePromiseStore::load() {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path_, error)) return {};  // a pipe would be waited for
  std::vector<std::uint8_t> bytes(kMaxPromise + 1);
  std::ifstream in(path_, std::ios::binary);
  in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(in.gcount()));
  return bytes.size() > kMaxPromise ? std::vector<std::uint8_t>() : bytes;
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
