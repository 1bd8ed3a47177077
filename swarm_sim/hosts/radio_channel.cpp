#include "swarm_sim/hosts/radio_channel.h"

#include <algorithm>
#include <utility>

namespace swarm {

void RadioChannel::send(Utime now, int robot_id, std::size_t datagram_bytes, std::function<void()> deliver) {
  ++counts_.sent;
  Utime& newest = stations_[robot_id].newest_handed_over;
  newest = std::max(newest, now + to_duration(to_seconds(kMostHandOver) * random_.uniform()));
  handed_over_.emplace(newest, HandOver{robot_id, {frame_duration(datagram_bytes, rate_mbps_), std::move(deliver)}});
}

Utime RadioChannel::due() const {
  const Utime next = is_busy() ? ends_ : sensed();
  return handed_over_.empty() ? next : std::min(next, handed_over_.begin()->first);
}

void RadioChannel::advance(Utime now) {
  for (Utime time = due(); time <= now; time = due()) {
    if (is_busy() && time == ends_) {
      end_frames();
    } else if (!is_busy() && time == sensed()) {
      begin_frames(time);
    } else {
      const auto first = handed_over_.begin();
      take(first->first, std::move(first->second));
      handed_over_.erase(first);
    }
  }
}

Utime RadioChannel::sensed() const {
  Utime first = kNever;
  for (const auto& [id, station] : stations_) {
    if (!station.queue.empty()) first = std::min(first, station.begins);
  }
  return first == kNever ? kNever : first + kSlotTime;
}

void RadioChannel::take(Utime now, HandOver handed_over) {
  Station& station = stations_[handed_over.robot_id];
  if (station.queue.size() >= kMostQueued) {
    const bool is_on_air = std::ranges::count(on_air_, &station) != 0;
    station.queue.erase(station.queue.begin() + (is_on_air ? 1 : 0));
    ++counts_.dropped;
  }
  station.queue.push_back(std::move(handed_over.frame));
  if (station.queue.size() > 1) return;
  const bool is_free = !is_busy() && now >= ends_ + kDifs;
  station.begins = is_free ? now : ends_ + kDifs + backoff();
}

void RadioChannel::begin_frames(Utime sensed) {
  const Utime first = sensed - kSlotTime;
  Utime ends{};
  for (auto& [id, station] : stations_) {
    if (station.queue.empty() || station.begins >= sensed) continue;
    on_air_.push_back(&station);
    ends = std::max(ends, station.begins + station.queue.front().duration);
  }
  ends_ = ends;
  for (auto& [id, station] : stations_) {
    if (station.queue.empty() || station.begins < sensed) continue;
    const auto slots = (station.begins - first + kSlotTime - 1us) / kSlotTime;  // that it has not counted down
    station.begins = ends_ + kDifs + slots * kSlotTime;
  }
}

void RadioChannel::end_frames() {
  const std::vector<Station*> ended = std::exchange(on_air_, {});
  for (Station* station : ended) {
    const Frame frame = std::move(station->queue.front());
    station->queue.pop_front();
    station->begins = ends_ + kDifs + backoff();
    if (ended.size() == 1) {
      frame.deliver();
    } else {
      ++counts_.collided;
    }
  }
}

Duration RadioChannel::backoff() {
  return static_cast<std::int64_t>(random_.uniform() * (kMostBackoffSlots + 1)) * kSlotTime;
}

}  // namespace swarm
