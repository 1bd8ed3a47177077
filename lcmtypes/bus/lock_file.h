// A file that one process has at a time, until it lets go or is gone.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

namespace swarm {

// Locks a file that is open, until it is closed by all that share the descriptor. Where somebody has it, `is_taken` is
// called: after that, unless it throws, it is waited for. Throws std::runtime_error with path and reason.
void lock_open_file(int descriptor, const std::filesystem::path& path, const std::function<void()>& is_taken);

class LockFile {
 public:
  // Makes the file where there is none. Throws std::runtime_error with path and reason: `who` has it, in words, or it
  // cannot be locked.
  LockFile(const std::filesystem::path& path, const std::string& who);
  ~LockFile();
  LockFile(const LockFile&) = delete;
  LockFile& operator=(const LockFile&) = delete;

  bool is_in_memory() const;  // where no disk is waited for

 private:
  int descriptor_;
};

}  // namespace swarm
