#include "tools/viewer/viewer.h"

#include <stdexcept>

namespace swarm {

Viewer::Viewer(std::unique_ptr<PictureSource> source, const OccupiedCubes* static_map)
    : source_(std::move(source)), static_map_(static_map) {}

void Viewer::on_message(std::string_view text) {
  try {
    const Json command = Json::parse(text);
    if (!command.is_object()) throw std::runtime_error("a command must be a JSON object");
    obey(command);
  } catch (const std::exception& error) {
    error_ = error.what();
    ++num_errors_;
  }
}

void Viewer::obey(const Json& command) {
  Json others = command;
  if (command.contains("select")) {
    selected_ = command["select"].is_null() ? -1 : command["select"].get<int>();
    source_->select(selected_);
  }
  if (command.contains("frame")) frame_ = command["frame"].get<int>();
  if (others.erase("select") + others.erase("frame") > 0) sent_ = {};
  if (!others.empty()) source_->control(others);
}

void Viewer::next_frame(std::vector<std::uint8_t>* bytes) {
  writer_.clear();
  const auto& [picture, utime] = source_->now();
  Json text = source_->describe();
  text["utime"] = to_us(utime);
  text["messages"] = picture.messages();
  text["refused"] = picture.refused().total();
  text["robots"] = robots_json(picture, utime, &writer_);
  text["obstacles"] = obstacles_json(picture, utime, selected_);
  if (num_errors_ > 0) text["error"] = {{"number", num_errors_}, {"text", error_}};
  if (static_map_ != nullptr && !static_map_sent_) {
    text["static_map"] = static_map_json(*static_map_, &writer_);
    static_map_sent_ = true;
  }
  if (const auto found = picture.robots().find(selected_); found != picture.robots().end()) {
    const RobotPicture& robot = found->second;
    text["selected"] = selected_;
    const std::int64_t corridors = robot.corridors ? robot.corridors->header.seq : 0;
    const Sent now = {robot.sogm.count(), corridors, robot.seen_space.count(), robot.scans.count()};
    if (now.sogm != sent_.sogm && robot.sogm.newest().num_frames > 0)
      text["sogm"] = sogm_json(robot.sogm.newest(), frame_, &writer_);
    if (now.corridors != sent_.corridors) text["corridors"] = corridors_json(robot, &writer_);
    if (now.seen_space != sent_.seen_space && robot.seen_space.newest().num_frames > 0)
      text["seen_space"] = sogm_json(robot.seen_space.newest(), 0, &writer_);
    if (now.scans != sent_.scans) text["scans"] = scans_json(robot, utime, &writer_);
    sent_ = now;
  } else {
    text["selected"] = nullptr;
  }
  writer_.finish(text, bytes);
}

}  // namespace swarm
