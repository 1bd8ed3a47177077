// Files that appear whole or not at all: written beside their place, then renamed.
#pragma once

#include <filesystem>
#include <string_view>

namespace swarm {

class AtomicFile {
 public:
  explicit AtomicFile(std::filesystem::path path);
  ~AtomicFile();  // removes what was not committed
  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&&) = delete;

  const std::filesystem::path& path() const { return path_; }
  const std::filesystem::path& temporary() const { return temporary_; }  // write here and close it, then commit()

  // Gives the file its name. Throws std::runtime_error with path and reason.
  void commit();

 private:
  std::filesystem::path path_, temporary_;
};

// Throws std::runtime_error with the path and what errno says.
[[noreturn]] void fail_to_write(const std::filesystem::path& path);

// Throws std::runtime_error with path and reason; then nothing has changed.
void write_file(const std::filesystem::path& path, std::string_view text);

}  // namespace swarm
