// The buses as they are: listens to those of any number of robots and to the one between them, and sends goals.
#pragma once

#include <memory>
#include <vector>

#include "lcmtypes/bus/realtime_host.h"
#include "tools/viewer/picture_source.h"

namespace swarm {

class LiveSource {
 public:
  struct Options {
    int base_port = kDefaultBasePort;         // of the swarm bus; robot k's onboard bus is this + 33 + k
    std::vector<int> onboard = {0, 1, 2, 3};  // robots whose onboard buses are on this computer
    bool replay = false;                      // messages are of another time
    bool allow_goals = false;                 // and orders
  };

  // Puts its listeners on the buses of `host`, which must outlive it. Throws what RealtimeHost::add throws.
  LiveSource(const Options& options, RealtimeHost* host);
  ~LiveSource();

  // For one browser; all of them see the same picture. Must not outlive this.
  std::unique_ptr<PictureSource> view();

 private:
  class Listener;
  class View;

  // A few times, for a bus may lose it. `boot` as in HeaderSource: new for each, or what others sent since would win.
  void send_goal(const Json& goal);
  void send_order(int robot, const std::string& name, double height_m, std::int32_t boot);
  Listener& listener_of(int robot, const char* what);

  Options options_;
  SwarmPicture picture_;
  Duration clock_offset_{};  // of the messages, when they are replayed
  std::vector<std::unique_ptr<Listener>> listeners_;
};

}  // namespace swarm
