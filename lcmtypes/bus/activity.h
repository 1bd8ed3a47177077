// What a node is about, in words for its operator, and when they belong into the log.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "lcmtypes/bus/recurring.h"
#include "lcmtypes/bus/time.h"

namespace swarm {

struct Activity {
  bool waits = false;       // for what the text names: until then the robot does not do what it is there for
  std::string text = {};    // "waits for GOAL"; empty: there is nothing to say
  std::string detail = {};  // what is different every time: "the last one is 0.8 s old"
};

// Says what is new, and again every ten seconds what is still waited for: as a warning, when it has waited so long.
class ActivityLog {
 public:
  static constexpr Duration kPeriod = 1s;  // it is asked so often: what is over sooner is not worth a line
  static constexpr Duration kPause = 3s;   // between lines: what changes all the time shall not fill the log
  static constexpr Duration kPatience = 10s;

  struct Line {
    bool is_warning = false;
    std::string text;
  };
  std::optional<Line> update(Utime now, const Activity& activity) {
    if (!activity.waits) waits_since_.reset();
    if (activity.waits && (!waits_since_ || *waits_since_ > now)) waits_since_ = now;
    const bool is_new = activity.text != told_;
    if (activity.text.empty() || !(is_new || activity.waits)) return std::nullopt;
    if (now < line_.due(now, is_new ? kPause : kPatience)) return std::nullopt;
    told_ = activity.text;
    line_.done(now);
    Line line{waits_since_ && now >= *waits_since_ + kPatience, (is_new ? "" : "still ") + activity.text};
    if (!activity.detail.empty()) line.text += ": " + activity.detail;
    return line;
  }

 private:
  std::string told_;
  Recurring line_;
  std::optional<Utime> waits_since_;
};

// What a node waits for that comes as a message.
inline Activity waits_for(std::string_view channel, std::string detail = {}) {
  return {true, "waits for " + std::string(channel), std::move(detail)};
}

}  // namespace swarm
