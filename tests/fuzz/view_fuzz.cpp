// A browser that watches a log: events of any time and content, and commands of any kind between frames. Every frame
// can be read and is of a time within the log, and a goal that is taken is one that robots take.
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "lcmtypes/bus/validate.h"
#include "tests/fuzz/fuzz_input.h"
#include "tools/viewer/goal_json.h"
#include "tools/viewer/log_player.h"
#include "tools/viewer/viewer.h"

namespace swarm::fuzz {
namespace {

// What goes on below a frame's text.
void check_arrays(const Json& json, std::size_t bytes) {
  if (json.is_object() && json.contains("at") && json.contains("count")) {
    const auto at = json["at"].get<std::size_t>(), count = json["count"].get<std::size_t>();
    expect(at % 4 == 0 && at <= bytes && count <= (bytes - at) / 2, "its arrays are in the frame");
  }
  if (!json.is_structured()) return;
  for (const auto& item : json.items()) check_arrays(item.value(), bytes);
}

void check_frame(const Bytes& frame) {
  expect(frame.size() >= 4, "a frame has the length of its text");
  const std::uint32_t length = frame[0] | frame[1] << 8 | frame[2] << 16 | std::uint32_t{frame[3]} << 24;
  expect(length <= frame.size() - 4, "its text is in it");
  const Json text = Json::parse(text_of(std::span(frame).subspan(4, length)));
  const std::size_t end = (4 + std::size_t{length} + 3) / 4 * 4;
  check_arrays(text, frame.size() - std::min(frame.size(), end));
  const double at_s = text.at("at_s").get<double>(), length_s = text.at("length_s").get<double>();
  expect(at_s >= 0.0 && at_s <= length_s, "it is of a time within the log");
}

// A log of messages a little later one after the other, now and then at any time at all.
Bytes log_of(FuzzInput& input) {
  Bytes log;
  std::uint64_t utime = 1'700'000'000'000'000;
  for (int events = input.integer(1, 24); events > 0; --events) {
    const std::uint8_t what = input.byte();
    const Channel& channel = kChannels[what % std::size(kChannels)];
    utime = what >= 0xF0 ? input.word(8) : utime + input.word(3);
    const Bytes bytes = message_bytes(input, channel.name);
    const std::string_view name = channel.name;
    const std::uint64_t words[] = {0xEDA1DA01, 0, utime, name.size(), bytes.size()};
    const std::size_t sizes[] = {4, 8, 8, 4, 4};
    for (std::size_t i = 0; i < std::size(words); ++i) {
      log.resize(log.size() + sizes[i]);
      write_big_endian(words[i], std::span(log).last(sizes[i]));
    }
    log.insert(log.end(), name.begin(), name.end());
    log.insert(log.end(), bytes.begin(), bytes.end());
  }
  return log;
}

// Mostly a good one, with one thing or the other that is none.
Json goal(FuzzInput& input) {
  const auto number = [&](double low, double high) { return input.flag() ? input.any_real() : input.real(low, high); };
  Json goal = {{"robot", input.integer(-1, 40'000)}, {"waypoints", Json::array()}};
  for (int left = input.byte() % 8; left > 0; --left) {
    Json& waypoint = goal["waypoints"].emplace_back(Json::object());
    waypoint["position"] = Json::array({number(-1e5, 1e5), number(-1e5, 1e5), input.real(0.0, 3.0)});
    if (input.flag()) waypoint["wait_s"] = number(0.0, 86'400.0);
  }
  if (input.flag()) goal["times"] = input.integer(0, 1001);
  if (input.byte() == 0) goal[input.text()] = input.byte();
  return goal;
}

// As a source with robots takes it; this one has a log.
void try_goal(const Json& goal) {
  try {
    const GoalOrder order = read_goal(goal);
    expect(order.robot_id >= 0 && validate(to_goal(order.mission)) == Refusal::kNone,
           "robots take a goal that is taken");
  } catch (const std::runtime_error& error) {
    expect(std::string_view(error.what()).find(": must ") != std::string_view::npos, "the line has the rule");
  }
}

std::string command(FuzzInput& input, double length_s) {
  switch (input.byte() % 8) {
    case 0:
      return input.text();
    case 1:
      return Json{{"select", input.flag() ? Json(input.byte() % 8) : Json()}}.dump();
    case 2:
      return Json{{"frame", input.integer(-2, 64)}}.dump();
    case 3:
      return Json{{"speed", input.flag() ? input.real(0.0, 200.0) : input.any_real()}}.dump();
    case 4:
      return Json{{"play", input.flag()}}.dump();
    case 5: {
      const Json sent = goal(input);
      try_goal(sent);
      return Json{{"goal", sent}}.dump(-1, ' ', false, Json::error_handler_t::replace);
    }
    default:
      return Json{{"play", false}, {"seek", input.flag() ? input.real(0.0, length_s) : input.any_real()}}.dump();
  }
}

}  // namespace

void try_input(FuzzInput input) {
  const MemoryFile file(log_of(input));
  std::optional<LogIndex> index;
  try {
    index.emplace(std::vector{file.path()});
  } catch (const std::runtime_error& error) {
    expect(std::string_view(error.what()).starts_with(file.path()), "the line names the file");
    return;
  }
  Viewer viewer(std::make_unique<LogPlayer>(*index), nullptr);
  Bytes frame;
  while (!input.empty()) {
    const std::string text = command(input, to_seconds(index->length()));
    const Json read = Json::parse(text, nullptr, false);
    if (read.is_object() && read.contains("goal")) try_goal(read["goal"]);
    viewer.on_message(text);
    viewer.next_frame(&frame);
    check_frame(frame);
  }
}

}  // namespace swarm::fuzz
