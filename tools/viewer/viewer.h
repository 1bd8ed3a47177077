// One browser: what it has asked for, and what it is sent.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "tools/viewer/picture_source.h"
#include "tools/viewer/web_server.h"

namespace swarm {

class Viewer : public WebClient {
 public:
  // `static_map` may be null; it must outlive this.
  Viewer(std::unique_ptr<PictureSource> source, const OccupiedCubes* static_map);

  // A JSON object: {"select": robot whose SOGM, corridors and sight are wanted, or null}, {"frame": of the SOGM, -1:
  // all}, and what the source's control() takes. What is wrong with it is told in the next frames.
  void on_message(std::string_view text) override;

  // The picture as it is now; static map, SOGM, corridors, scans and what was seen only where they have changed since
  // the last frame.
  void next_frame(std::vector<std::uint8_t>* bytes) override;

 private:
  void obey(const Json& command);

  std::unique_ptr<PictureSource> source_;
  const OccupiedCubes* static_map_;
  int selected_ = -1, frame_ = -1;
  bool static_map_sent_ = false;
  struct Sent {  // already, of the selected robot; -1: nothing
    std::int64_t sogm = -1, corridors = -1, seen_space = -1, scans = -1;
  } sent_;
  std::string error_;
  std::int64_t num_errors_ = 0;
  FrameWriter writer_;
};

}  // namespace swarm
