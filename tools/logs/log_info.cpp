// What a log of a bus holds: channels, rates, gaps, planning times, what became of plans, refusals and losses.
#include <algorithm>
#include <array>
#include <deque>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/codec.h"
#include "lcmtypes/bus/lcm_log.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/text.h"
#include "lcmtypes/bus/timing_stats.h"
#include "planner_daemon/coordination/commit_protocol.h"
#include "tools/logs/log_messages.h"

namespace swarm {
namespace {

using namespace sogm_swarm;

struct Channel {
  std::int64_t messages = 0, bytes = 0, refused = 0;
  Utime first{}, last{};
  Duration longest_gap{};
};

// Announcements of one sender on one channel, by their numbers.
struct Announced {
  std::int64_t heard = 0, lost = 0, restarts = 0;
  std::int32_t boot = -1;
  std::int64_t seq = 0;
};

// Counts since start, which begin at 0 again with every boot: the sum over all of them.
class Total {
 public:
  void add(std::int32_t boot, std::int64_t count) {
    if (boot != boot_) before_ += newest_;
    boot_ = boot;
    newest_ = count;
  }
  std::int64_t sum() const { return before_ + newest_; }

 private:
  std::int32_t boot_ = -1;
  std::int64_t before_ = 0, newest_ = 0;
};

// From an obstacle's message to the begin of the motion that answers it: of each message the first map that can hold
// it, the first plan made of that map or, where none could be made in time, the next one, and when what was planned
// begins, if it was committed. Not of the first that was: it departs, and what came before it waited for that. Nor of
// what asked for nothing: a calm planner looks at a map and lets it be.
class Reactions {
 public:
  void obstacles(Utime sensed) { sensed_.push_back(sensed); }
  void map(Utime built) {
    maps_.push_back({built, std::move(sensed_)});
    sensed_.clear();
  }
  void candidate(Utime start) { start_ = start, is_new_ = true; }
  // Of the maps since the plan before, `missed` waited for this one. The candidate comes before.
  void planned(Utime planned, std::int64_t missed) {
    std::vector<Utime> sensed;
    for (; !maps_.empty() && maps_.front().built < planned; maps_.pop_front()) {
      const bool is_planned_with = maps_.size() == 1 || maps_[1].built >= planned;
      if (!is_planned_with && missed-- <= 0) continue;
      sensed.insert(sensed.end(), maps_.front().sensed.begin(), maps_.front().sensed.end());
    }
    if (std::exchange(is_new_, false)) answered_ = std::move(sensed);  // else what is flown was the better answer
  }
  void committed(Utime start) {
    if (start != start_) return;
    for (const Utime sensed : answered_) {
      if (departed_) ms_.push_back(to_ms(start - sensed));
    }
    departed_ = true;
    answered_.clear();
  }
  const std::vector<double>& ms() const { return ms_; }

 private:
  struct Map {
    Utime built;
    std::vector<Utime> sensed;  // not in an earlier one
  };

  std::vector<Utime> sensed_, answered_;  // not in a map yet; by the newest candidate
  std::deque<Map> maps_;                  // not planned with yet
  Utime start_{};
  bool is_new_ = false, departed_ = false;  // the candidate; the robot
  std::vector<double> ms_;
};

// Of perception's states, one a second.
struct Sight {
  Total scans, blind, jumps;
  std::int64_t states = 0, points = 0, masked = 0, moving = 0, standing = 0;

  std::string text() const {
    if (states == 0) return "";
    const auto mean = [](std::int64_t sum, std::int64_t count) {
      return count == 0 ? 0.0 : static_cast<double>(sum) / static_cast<double>(count);
    };
    return "    " + std::to_string(scans.sum()) + " scans, " + std::to_string(blind.sum()) + " saw nothing, " +
           std::to_string(jumps.sum()) + " jumps of the pose; " + fixed(mean(points, states), 0) + " points each, " +
           fixed(100.0 * mean(masked, points), 1) + " % on robots; " + fixed(mean(moving, states), 1) +
           " obstacles move, " + fixed(mean(standing, states), 1) + " stand\n";
  }
};

struct Robot {
  std::vector<double> plan_ms, build_ms, scan_ms;
  Sight sight;
  Total missed, candidates, commits, forced, withdrawn;
  std::array<Total, kNumRejections> rejected;
  std::map<std::string, std::array<Total, kNumRefusals>> refused;  // by daemon
  std::int32_t plans = -1;
  Reactions reactions;
};

template <class Status>
void add_refused(const Status& status, const char* daemon, Robot* robot) {
  auto& totals = robot->refused[daemon];
  for (std::size_t i = 0; i < totals.size(); ++i) totals[i].add(status.header.boot, status.refused[i]);
}

class Summary {
 public:
  void add(const LogEvent& event) {
    Channel& channel = channels_[event.channel];
    if (channel.messages++ == 0) {
      channel.first = event.utime;
    } else {
      channel.longest_gap = std::max(channel.longest_gap, event.utime - channel.last);
    }
    channel.last = event.utime;
    channel.bytes += static_cast<std::int64_t>(event.bytes.size());
    first_ = messages_ == 0 ? event.utime : std::min(first_, event.utime);
    last_ = messages_++ == 0 ? event.utime : std::max(last_, event.utime);
    if (const Refusal refusal = read(event); refusal != Refusal::kNone) {
      ++channel.refused;
      ++refusals_[event.channel][refusal];
    }
  }

  std::string text(const std::string& path, std::int64_t skipped) const {
    const double seconds = to_seconds(last_ - first_);
    std::string out = path + ": " + fixed(seconds, 2) + " s, " + std::to_string(messages_) + " messages\n";
    if (skipped > 0) out += "  damaged: " + std::to_string(skipped) + " bytes are no events\n";
    std::vector<std::vector<std::string>> rows = {
        {"channel", "messages", "per s", "bytes each", "longest gap s", "not readable"}};
    for (const auto& [name, channel] : channels_) {
      const double span = to_seconds(channel.last - channel.first);
      rows.push_back({name, std::to_string(channel.messages),
                      span > 0.0 ? fixed(static_cast<double>(channel.messages - 1) / span, 1) : "-",
                      std::to_string(channel.bytes / channel.messages), fixed(to_seconds(channel.longest_gap), 3),
                      std::to_string(channel.refused)});
    }
    out += aligned(rows);
    for (const auto& [name, reasons] : refusals_) {
      out += "  " + name + ": not readable:";
      for (const auto& [reason, count] : reasons)
        out.append(" ").append(to_string(reason)).append(" ").append(std::to_string(count));
      out += '\n';
    }
    for (const auto& [id, robot] : robots_) out += text_of_robot(id, robot);
    for (const auto& [key, announced] : announced_) {
      out += "  robot " + std::to_string(key.second) + " on " + key.first + ": " + std::to_string(announced.heard) +
             " announcements, " + std::to_string(announced.lost) + " missing (" +
             fixed(100.0 * static_cast<double>(announced.lost) / static_cast<double>(announced.heard + announced.lost),
                   1) +
             " %), " + std::to_string(announced.restarts) + " restarts\n";
    }
    return out;
  }

 private:
  // Messages of other types count as readable.
  Refusal read(const LogEvent& event) {
    return visit_message(event.channel, event.bytes, [&](const auto& message) { note(event, message); })
        .value_or(Refusal::kNone);
  }

  void note(const LogEvent& event, const announcement_t& m) {
    add_announcement(event.channel, m.header);
    if (event.channel != channel::kOwnTrajectory) return;
    if (m.pending_state == announcement_t::kCommitted)
      robots_[m.header.robot_id].reactions.committed(to_utime(m.pending.start_utime));
  }
  void note(const LogEvent&, const obstacles_t& m) {
    robots_[m.header.robot_id].reactions.obstacles(to_utime(m.header.utime));
  }
  void note(const LogEvent&, const obstacle_voxels_t& m) {
    robots_[m.header.robot_id].reactions.obstacles(to_utime(m.header.utime));
  }
  void note(const LogEvent& event, const sogm_t& m) {
    if (event.channel == channel::kSogm && m.part == m.num_parts - 1)
      robots_[m.header.robot_id].reactions.map(to_utime(m.header.utime));
  }
  void note(const LogEvent&, const candidate_t& m) {
    robots_[m.header.robot_id].reactions.candidate(to_utime(m.trajectory.start_utime));
  }
  void note(const LogEvent&, const planner_status_t& m) {
    Robot& robot = robots_[m.header.robot_id];
    if (m.plans != robot.plans && m.plans > 0) robot.plan_ms.push_back(m.total_ms);
    const std::int64_t missed_before = robot.missed.sum();
    robot.missed.add(m.header.boot, m.missed);
    if (m.plans != robot.plans) robot.reactions.planned(to_utime(m.header.utime), robot.missed.sum() - missed_before);
    robot.plans = m.plans;
    add_refused(m, "planner", &robot);
  }
  void note(const LogEvent&, const broadcast_status_t& m) {
    Robot& robot = robots_[m.header.robot_id];
    const std::int32_t boot = m.header.boot;
    robot.candidates.add(boot, m.candidates);
    robot.commits.add(boot, m.commits);
    robot.forced.add(boot, m.forced);
    robot.withdrawn.add(boot, m.withdrawn);
    for (std::size_t i = 0; i < robot.rejected.size(); ++i) robot.rejected[i].add(boot, m.rejected[i]);
    add_refused(m, "broadcast", &robot);
  }
  void note(const LogEvent&, const map_status_t& m) {
    Robot& robot = robots_[m.header.robot_id];
    robot.build_ms.push_back(m.build_ms);
    add_refused(m, "map", &robot);
  }
  void note(const LogEvent&, const perception_status_t& m) {
    Robot& robot = robots_[m.header.robot_id];
    const std::int32_t boot = m.header.boot;
    robot.scan_ms.push_back(m.scan_ms);
    Sight& sight = robot.sight;
    sight.scans.add(boot, m.scans);
    sight.blind.add(boot, m.blind);
    sight.jumps.add(boot, m.jumps);
    ++sight.states;
    sight.points += m.points;
    sight.masked += m.masked;
    sight.moving += m.moving;
    sight.standing += m.standing;
    add_refused(m, "perception", &robot);
  }
  template <class T>
  void note(const LogEvent&, const T&) {}

  void add_announcement(const std::string& channel, const header_t& header) {
    Announced& announced = announced_[{channel, header.robot_id}];
    const bool same_boot = announced.boot == header.boot;
    if (same_boot && header.seq <= announced.seq) return;  // doubled or overtaken
    if (same_boot) announced.lost += header.seq - announced.seq - 1;
    if (!same_boot && announced.boot >= 0) ++announced.restarts;
    announced.boot = header.boot;
    announced.seq = header.seq;
    ++announced.heard;
  }

  static std::string text_of_timing(const char* what, const std::vector<double>& samples_ms) {
    const TimingStats stats = timing_stats(samples_ms);
    if (stats.count == 0 || stats.max_ms == 0.0) return "";  // lock-step: no durations
    return std::string("    ") + what + " ms: p50 " + fixed(stats.p50_ms, 3) + ", p95 " + fixed(stats.p95_ms, 3) +
           ", p99 " + fixed(stats.p99_ms, 3) + ", max " + fixed(stats.max_ms, 3) + "\n";
  }

  static std::string text_of_robot(int id, const Robot& robot) {
    std::string out = "  robot " + std::to_string(id) + ": " + std::to_string(robot.plan_ms.size()) + " plans, " +
                      std::to_string(robot.missed.sum()) + " maps missed; " + std::to_string(robot.candidates.sum()) +
                      " candidates, " + std::to_string(robot.commits.sum()) + " committed (" +
                      std::to_string(robot.forced.sum()) + " forced), " + std::to_string(robot.withdrawn.sum()) +
                      " withdrawn";
    std::string rejected;
    for (std::size_t i = 1; i < robot.rejected.size(); ++i) {
      if (robot.rejected[i].sum() > 0)
        rejected.append(" ")
            .append(to_string(static_cast<Rejection>(i)))
            .append(" ")
            .append(std::to_string(robot.rejected[i].sum()));
    }
    out += (rejected.empty() ? "" : ", rejected:" + rejected) + "\n";
    out += text_of_timing("plan", robot.plan_ms) + text_of_timing("map", robot.build_ms) +
           text_of_timing("obstacle to motion", robot.reactions.ms()) + robot.sight.text() +
           text_of_timing("scan", robot.scan_ms);
    for (const auto& [daemon, totals] : robot.refused) {
      std::string reasons;
      for (std::size_t i = 1; i < totals.size(); ++i) {
        if (totals[i].sum() > 0)
          reasons.append(" ")
              .append(to_string(static_cast<Refusal>(i)))
              .append(" ")
              .append(std::to_string(totals[i].sum()));
      }
      if (!reasons.empty()) out += "    refused by its " + daemon + "_daemon:" + reasons + "\n";
    }
    return out;
  }

  std::map<std::string, Channel> channels_;
  std::map<std::string, std::map<Refusal, std::int64_t>> refusals_;
  std::map<int, Robot> robots_;
  std::map<std::pair<std::string, int>, Announced> announced_;
  std::int64_t messages_ = 0;
  Utime first_{}, last_{};
};

int log_info(int argc, const char* const* argv) {
  std::vector<std::string> paths;
  OptionSet options(
      "log_info",
      "Summarises LCM logs, as of swarm_sim run --out, tools/record or lcm-logger: channels with rates, gaps "
      "and what\ncannot be read, planning times, what became of plans, how soon obstacles were answered, refusals, "
      "losses. Exit code 2 when a "
      "log cannot be read.");
  options.add_positional("LOG", &paths, "LCM log");
  if (options.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return 0;
  if (paths.empty()) throw OptionError("a log must be given (see --help)");
  for (const std::string& path : paths) {
    LcmLog log(path);
    Summary summary;
    LogEvent event;
    std::int64_t events = 0;
    for (; log.next(&event); ++events) summary.add(event);
    if (events == 0)
      throw std::runtime_error(path + ": holds no LCM events (" + std::to_string(log.size()) + " bytes)");
    std::cout << summary.text(path, log.skipped());
  }
  return 0;
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) try { return swarm::log_info(argc, argv); } catch (const std::exception& error) {
  std::cerr << "log_info: " << error.what() << std::endl;
  return 2;
}
