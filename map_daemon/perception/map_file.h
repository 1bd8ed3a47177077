// The OctoMap file in which a robot keeps what it has seen to stand, from one flight to the next.
#pragma once

#include <atomic>
#include <filesystem>
#include <thread>
#include <utility>

#include "map_daemon/perception/kept_map.h"

namespace swarm {

class MapFile {
 public:
  explicit MapFile(std::filesystem::path path) : path_(std::move(path)) {}
  // Waits until what is being written is written.
  ~MapFile() = default;
  MapFile(const MapFile&) = delete;
  MapFile& operator=(const MapFile&) = delete;

  // What the file holds; nothing where there is none yet. Throws std::runtime_error, one line that names the file, when
  // it is no OctoMap (.bt) that can be kept, or can never be written.
  KeptMap read(double resolution_m) const;

  // Writes it beside what the caller goes on to do: the file is the old one until it is the new one. False: the one
  // before is still being written.
  bool begin_writing(KeptMap map);
  // Writes it now.
  void write(const KeptMap& map);
  // Waits until nothing is being written.
  void finish() { writer_ = std::jthread(); }

  bool is_writing() const { return is_writing_; }
  int written() const { return written_; }         // times
  bool has_failed() const { return has_failed_; }  // the last time; the log says why

 private:
  std::filesystem::path path_;
  std::atomic<int> written_ = 0;
  std::atomic<bool> is_writing_ = false, has_failed_ = false;
  std::jthread writer_;  // the last member: it ends first
};

}  // namespace swarm
