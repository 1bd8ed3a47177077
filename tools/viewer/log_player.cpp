#include "tools/viewer/log_player.h"

#include <algorithm>
#include <map>
#include <stdexcept>
#include <tuple>

#include "lcmtypes/bus/channels.h"

namespace swarm {
namespace {

constexpr Duration kBefore = 1s;  // all of the last second is read, for rates
constexpr double kMinSpeed = 0.01, kMaxSpeed = 100.0;

// Where every message has its robot, a sensor's its sensor, and what comes in parts its part.
constexpr std::size_t kRobotAt = 14, kSensorAt = 36, kMapPartAt = 68, kScanPartAt = 94;

int short_at(std::size_t at, const std::vector<std::uint8_t>& bytes) {
  return bytes.size() < at + 2 ? -1 : bytes[at] << 8 | bytes[at + 1];
}

// The newest of each is needed to know where things are.
using Kind = std::tuple<std::string, int, int, int>;
Kind kind_of(const LogEvent& event) {
  const std::string& name = event.channel;
  const bool is_scan = name == channel::kLidarScan, is_map = name == channel::kSogm || name == channel::kSeenSpace;
  const int sensor = is_scan || name == channel::kDepthImage ? short_at(kSensorAt, event.bytes) : 0;
  const int part = is_scan ? short_at(kScanPartAt, event.bytes) : is_map ? short_at(kMapPartAt, event.bytes) : 0;
  return {name, short_at(kRobotAt, event.bytes), sensor, part};
}

}  // namespace

LogIndex::LogIndex(const std::vector<std::string>& paths) : paths_(paths) {
  std::map<Kind, std::uint32_t> kinds;
  LogEvent event;
  for (std::uint32_t file = 0; file < paths.size(); ++file) {
    LcmLog log(paths[file]);
    const std::size_t before = entries_.size();
    while (log.next(&event)) {
      const auto kind = kinds.try_emplace(kind_of(event), static_cast<std::uint32_t>(kinds.size()));
      entries_.push_back({event.utime, event.offset, kind.first->second, file});
    }
    if (entries_.size() == before) {
      throw std::runtime_error(paths[file] + ": holds no LCM events (" + std::to_string(log.size()) + " bytes)");
    }
    skipped_ += log.skipped();
  }
  if (entries_.empty()) throw std::runtime_error("a log must be given");
  std::stable_sort(entries_.begin(), entries_.end(), [](const Entry& a, const Entry& b) { return a.utime < b.utime; });
  by_kind_.resize(kinds.size());
  for (std::size_t i = 0; i < entries_.size(); ++i) by_kind_[entries_[i].kind].push_back(static_cast<std::uint32_t>(i));
}

LogPlayer::LogPlayer(const LogIndex& index) : index_(index) {
  for (const std::string& path : index.paths()) logs_.emplace_back(path);
  shown_ = index.begin_utime();
  set_from(index.begin_utime());
}

Utime LogPlayer::wanted() const {
  if (!playing_) return from_;
  const auto passed = std::chrono::duration_cast<Duration>(Clock::now() - since_);
  return std::clamp(from_ + to_duration(speed_ * to_seconds(passed)), index_.begin_utime(), index_.end_utime());
}

void LogPlayer::set_from(Utime utime) {
  from_ = std::clamp(utime, index_.begin_utime(), index_.end_utime());
  since_ = Clock::now();
}

void LogPlayer::feed(std::size_t entry) {
  const LogIndex::Entry& from = index_.entries()[entry];
  LcmLog& log = logs_[from.file];
  log.go_to(from.offset);
  if (log.next(&event_)) (void)picture_.add(from.utime, event_.channel, event_.bytes);
}

// The newest of every kind from before the last second, then all of that second.
void LogPlayer::go_back_to(Utime utime) {
  picture_ = SwarmPicture(selected_);
  const auto& entries = index_.entries();
  const auto first = std::lower_bound(entries.begin(), entries.end(), utime - kBefore,
                                      [](const LogIndex::Entry& entry, Utime t) { return entry.utime < t; });
  next_ = static_cast<std::size_t>(first - entries.begin());
  std::vector<std::uint32_t> newest;
  for (const std::vector<std::uint32_t>& kind : index_.by_kind()) {
    const auto after = std::lower_bound(kind.begin(), kind.end(), next_);
    if (after != kind.begin()) newest.push_back(*(after - 1));
  }
  std::sort(newest.begin(), newest.end());
  for (const std::uint32_t entry : newest) feed(entry);
}

void LogPlayer::select(int robot) {
  selected_ = robot;
  go_back_to(shown_);
}

PictureSource::Moment LogPlayer::now() {
  const Utime utime = wanted();
  if (utime < shown_ || utime > shown_ + 2 * kBefore) go_back_to(utime);
  while (next_ < index_.entries().size() && index_.entries()[next_].utime <= utime) feed(next_++);
  shown_ = utime;
  if (playing_ && utime == index_.end_utime()) {
    playing_ = false;
    set_from(utime);
  }
  return {picture_, shown_};
}

Json LogPlayer::describe() {
  return {{"mode", "log"},
          {"names", index_.paths()},
          {"damaged_bytes", index_.skipped()},
          {"length_s", to_seconds(index_.length())},
          {"at_s", to_seconds(shown_ - index_.begin_utime())},
          {"playing", playing_},
          {"speed", speed_}};
}

void LogPlayer::control(const Json& command) {
  if (command.contains("goal")) throw std::runtime_error("a log cannot be given goals");
  if (command.contains("play")) {
    const bool play = command["play"].get<bool>();
    set_from(play && wanted() == index_.end_utime() ? index_.begin_utime() : wanted());
    playing_ = play;
  }
  if (command.contains("seek")) {
    const double seek_s = command["seek"].get<double>();
    const double length_s = to_seconds(index_.length());
    if (!(seek_s >= 0.0 && seek_s <= length_s)) {
      throw std::runtime_error("seek " + std::to_string(seek_s) + " s: must be within [0, " + std::to_string(length_s) +
                               "]");
    }
    set_from(index_.begin_utime() + to_duration(seek_s));
  }
  if (command.contains("speed")) {
    const double speed = command["speed"].get<double>();
    if (!(speed >= kMinSpeed && speed <= kMaxSpeed))
      throw std::runtime_error("speed " + std::to_string(speed) + ": must be within [0.01, 100]");
    set_from(wanted());
    speed_ = speed;
  }
}

}  // namespace swarm
