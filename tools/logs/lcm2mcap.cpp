// Converts LCM logs of our buses into one MCAP file: every message as JSON, and drawings of them in Foxglove's schemas.
#include <algorithm>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "lcmtypes/bus/lcm_log.h"
#include "lcmtypes/bus/option_set.h"
#include "lcmtypes/bus/text.h"
#include "tools/logs/foxglove.h"
#include "tools/logs/log_drawing.h"
#include "tools/logs/log_messages.h"
#include "tools/logs/mcap_writer.h"
#include "tools/logs/message_json.h"

namespace swarm {
namespace {

namespace fs = std::filesystem;

constexpr const char* kUsage =
    "Converts LCM logs into one MCAP file for Foxglove, Lichtblick and Rerun; tools/lcm2mcap --help tells what is in "
    "it.";

struct Arguments {
  std::vector<std::string> logs;
  std::string out;
  bool force = false;
  double map_rate_hz = 5.0;
};

void declare(OptionSet& options, Arguments& arguments) {
  options.add_positional("LOG", &arguments.logs, "LCM log; several are merged in order of time");
  options.add("out", &arguments.out, "file to write; none: the first log's name, ending in .mcap");
  options.add("map-rate", &arguments.map_rate_hz, 0.01, 1000, "Hz", "at most so many maps of each robot are drawn");
  options.add("force", &arguments.force, "replace a file that exists");
}

void check_output(const Arguments& arguments) {
  const fs::path out = arguments.out, directory = out.parent_path();
  if (!directory.empty() && !fs::is_directory(directory))
    throw std::runtime_error(arguments.out + ": there is no directory '" + directory.string() + "'");
  if (!fs::exists(out)) return;
  for (const std::string& log : arguments.logs) {
    if (fs::exists(log) && fs::equivalent(log, out))
      throw std::runtime_error(arguments.out + ": is one of the logs, choose another name with --out");
  }
  if (!fs::is_regular_file(out)) throw std::runtime_error(arguments.out + ": is no file");
  if (!arguments.force) throw std::runtime_error(arguments.out + ": exists already (--force true replaces it)");
}

bool is_of_swarm(const std::string& channel) {
  return std::ranges::any_of(channels_of(BusId::kSwarm), [&](const char* kind) { return kind_of(channel) == kind; });
}

// A log, its next event, and the robot whose onboard bus it is of, if any.
class Source {
 public:
  explicit Source(const std::string& path) : log_(path) {
    has_event_ = log_.next(&event_);
    if (!has_event_)
      throw std::runtime_error(path + ": holds no LCM events (" + std::to_string(log_.size()) + " bytes)");
    LcmLog ahead(path);
    for (LogEvent event; !owner_ && ahead.next(&event);) {
      // Trajectories name their sender, who may be a peer.
      if (is_of_swarm(event.channel) || event.channel == channel::kPeerTrajectory) continue;
      (void)visit_message(event.channel, event.bytes,
                          [this](const auto& message) { owner_ = message.header.robot_id; });
    }
  }

  bool has_event() const { return has_event_; }
  const LogEvent& event() const { return event_; }
  void advance() { has_event_ = log_.next(&event_); }
  std::optional<int> owner() const { return owner_; }
  std::int64_t skipped() const { return log_.skipped(); }
  std::int64_t size() const { return log_.size(); }

 private:
  LcmLog log_;
  LogEvent event_;
  bool has_event_ = false;
  std::optional<int> owner_;
};

class Converter {
 public:
  explicit Converter(const Arguments& arguments)
      : writer_(arguments.out, "lcm2mcap"),
        drawing_({.map_interval_s = 1.0 / arguments.map_rate_hz}, [this](const Drawing& drawing) {
          const char* const name = drawing.schema;
          write(
              drawing.topic, name, [name] { return foxglove::schema(name); }, drawing.message);
        }) {}

  void add(const LogEvent& event, std::optional<int> owner) {
    ++events_;
    first_utime_ = std::min(first_utime_, event.utime);
    last_utime_ = std::max(last_utime_, event.utime);
    utime_ = event.utime;
    const auto refusal = visit_message(event.channel, event.bytes, [&]<class T>(const T& message) {
      write(topic_of(event.channel, message.header.robot_id, owner), schema_name<T>(), json_schema<T>,
            to_json(message));
      drawing_.add(event.utime, event.channel, message);
    });
    if (!refusal) {
      ++others_[event.channel];
    } else if (*refusal != Refusal::kNone) {
      ++refused_[event.channel + " " + to_string(*refusal)];
    }
  }

  void close() { writer_.close(); }

  std::string summary(const std::string& out, std::int64_t log_bytes, std::int64_t skipped) const {
    std::string text = out + ": ";
    append_fixed(last_utime_ < first_utime_ ? 0.0 : to_seconds(last_utime_ - first_utime_), 2, &text);
    text += " s, " + std::to_string(events_) + " events, " + std::to_string(writer_.messages()) + " messages on " +
            std::to_string(writer_.channels()) + " topics, " + megabytes(writer_.bytes()) +
            " MB (logs: " + megabytes(static_cast<std::uint64_t>(log_bytes)) + " MB)\n";
    if (skipped > 0) text += "  damaged: " + std::to_string(skipped) + " bytes are no events\n";
    text += list("not readable", refused_) + list("on channels that are not ours", others_);
    return text;
  }

 private:
  using Counts = std::map<std::string, std::int64_t>;

  static std::string topic_of(const std::string& channel, int robot_id, std::optional<int> owner) {
    if (is_of_swarm(channel)) return "/swarm/" + channel;
    if (channel != channel::kPeerTrajectory) return "/robot" + std::to_string(robot_id) + "/" + channel;
    return (owner ? "/robot" + std::to_string(*owner) : "/onboard") + "/" + channel;
  }

  static std::string megabytes(std::uint64_t bytes) {
    std::string text;
    append_fixed(1e-6 * static_cast<double>(bytes), 1, &text);
    return text;
  }

  static std::string list(const char* what, const Counts& counts) {
    std::int64_t sum = 0;
    std::string text;
    for (const auto& [name, count] : counts) {
      sum += count;
      text += (text.empty() ? "" : ", ") + name + " " + std::to_string(count);
    }
    return counts.empty() ? "" : std::string("  left out, ") + what + ": " + std::to_string(sum) + " (" + text + ")\n";
  }

  template <class MakeSchema>
  void write(const std::string& topic, const std::string& schema, const MakeSchema& make_schema,
             const nlohmann::ordered_json& message) {
    auto channel = channels_.find(topic);
    if (channel == channels_.end()) {
      auto known = schemas_.find(schema);
      if (known == schemas_.end())
        known = schemas_.emplace(schema, writer_.add_schema(schema, "jsonschema", make_schema().dump())).first;
      channel = channels_.emplace(topic, writer_.add_channel(known->second, topic, "json")).first;
    }
    writer_.write(channel->second, static_cast<std::uint64_t>(to_us(utime_)) * 1000, message.dump());
  }

  McapWriter writer_;
  LogDrawing drawing_;
  std::map<std::string, std::uint16_t> schemas_, channels_;
  Utime utime_{}, first_utime_ = kNever, last_utime_{};
  std::int64_t events_ = 0;
  Counts refused_, others_;  // by channel
};

int lcm2mcap(int argc, const char* const* argv) {
  Arguments arguments;
  OptionSet options("lcm2mcap", kUsage);
  declare(options, arguments);
  if (options.parse(argc, argv, std::cout) == OptionSet::Parsed::kExit) return 0;
  if (arguments.logs.empty()) throw OptionError("a log must be given (see --help)");
  if (arguments.out.empty()) arguments.out = fs::path(arguments.logs.front()).replace_extension(".mcap").string();
  std::vector<std::unique_ptr<Source>> sources;
  for (const std::string& log : arguments.logs) sources.push_back(std::make_unique<Source>(log));
  check_output(arguments);
  Converter converter(arguments);
  while (true) {
    Source* next = nullptr;
    for (const auto& source : sources) {
      if (source->has_event() && (next == nullptr || source->event().utime < next->event().utime)) next = source.get();
    }
    if (next == nullptr) break;
    converter.add(next->event(), next->owner());
    next->advance();
  }
  converter.close();
  std::int64_t bytes = 0, skipped = 0;
  for (const auto& source : sources) bytes += source->size(), skipped += source->skipped();
  std::cout << converter.summary(arguments.out, bytes, skipped);
  return 0;
}

}  // namespace
}  // namespace swarm

int main(int argc, char** argv) try { return swarm::lcm2mcap(argc, argv); } catch (const std::exception& error) {
  std::cerr << "lcm2mcap: " << error.what() << std::endl;
  return 2;
}
