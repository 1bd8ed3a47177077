// LCM logs for the view: an index of all their events by time and kind, and players that each show them at a time of
// their own, forwards, backwards and at any speed.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "lcmtypes/bus/lcm_log.h"
#include "tools/viewer/picture_source.h"

namespace swarm {

// What several logs hold, by the time it was recorded. 28 bytes of memory an event.
class LogIndex {
 public:
  // Throws std::runtime_error that names the file when one cannot be read or holds no events.
  explicit LogIndex(const std::vector<std::string>& paths);

  struct Entry {
    Utime utime;          // when it was recorded
    std::int64_t offset;  // in its file
    std::uint32_t kind;   // channel, robot and part of a map
    std::uint32_t file;
  };

  const std::vector<std::string>& paths() const { return paths_; }
  const std::vector<Entry>& entries() const { return entries_; }  // ascending in utime; never empty
  // Which entries are of a kind, ascending.
  const std::vector<std::vector<std::uint32_t>>& by_kind() const { return by_kind_; }
  Utime begin_utime() const { return entries_.front().utime; }
  Utime end_utime() const { return entries_.back().utime; }
  Duration length() const { return end_utime() - begin_utime(); }
  std::int64_t skipped() const { return skipped_; }  // bytes that are no events

 private:
  std::vector<std::string> paths_;
  std::vector<Entry> entries_;
  std::vector<std::vector<std::uint32_t>> by_kind_;
  std::int64_t skipped_ = 0;
};

// One browser's place in the logs. `index` must outlive it.
class LogPlayer : public PictureSource {
 public:
  explicit LogPlayer(const LogIndex& index);

  Moment now() override;
  Json describe() override;
  void select(int robot) override;
  // {"play": bool}, {"seek": s after the beginning}, {"speed": [0.01, 100]}.
  void control(const Json& command) override;

 private:
  using Clock = std::chrono::steady_clock;
  Utime wanted() const;
  void set_from(Utime utime);  // where it plays from, as of now
  void go_back_to(Utime utime);
  void feed(std::size_t entry);

  const LogIndex& index_;
  std::vector<LcmLog> logs_;
  int selected_ = -1;  // robot whose maps the picture has
  SwarmPicture picture_{selected_};
  std::size_t next_ = 0;  // entry that was not fed yet
  Utime shown_{};         // the picture is of then
  Utime from_{};          // it was, at `since_`
  Clock::time_point since_;
  bool playing_ = true;
  double speed_ = 1.0;
  LogEvent event_;
};

}  // namespace swarm
