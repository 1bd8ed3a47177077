#include "tools/viewer/live_source.h"

#include <cmath>
#include <stdexcept>

#include "lcmtypes/bus/boot.h"
#include "lcmtypes/bus/channels.h"
#include "lcmtypes/bus/header_source.h"
#include "lcmtypes/bus/limits.h"
#include "lcmtypes/bus/recurring.h"
#include "planner_daemon/trajectory/mission.h"
#include "tools/operator/goal_order.h"
#include "tools/viewer/goal_json.h"

namespace swarm {
namespace {

constexpr Duration kStep = 50ms;
constexpr int kRepeat = 5;              // times what is sent, for a bus may lose it
constexpr double kOldMessages_s = 5.0;  // then the log's time is meant, not the clock's
constexpr Duration kLately = 1s;

}  // namespace

// On one bus.
class LiveSource::Listener : public Node {
 public:
  Listener(LiveSource* source, BusId bus, int robot, std::string url)
      : source_(source), bus_(bus), robot_(robot), url_(std::move(url)) {}

  std::vector<Subscription> subscriptions() const override {
    std::vector<Subscription> all;
    for (const char* name : channels_of(bus_)) all.push_back({bus_, name});
    return all;
  }

  void on_message(Utime now, BusId, std::string_view name, std::span<const std::uint8_t> bytes, Outbox&) override {
    source_->clock_offset_ = now - wall_utime();
    (void)source_->picture_.add(now, name, bytes);
    ++messages_;
  }

  Utime step(Utime now, Outbox& outbox) override {
    goal_.send(now, channel::kGoal, bus_, outbox);
    order_.send(now, channel::kFlightOrder, bus_, outbox);
    return now + kStep;
  }

  // The newest wins, by `boot`: other programs may have sent some since.
  void send_goal(const Mission& mission, std::int32_t boot) {
    send_order(sogm_swarm::order_t::kFly, 0.0, boot);  // it may hold its place
    goal_.take(to_goal(mission), robot_, boot);
  }
  void send_order(std::int16_t order, double height_m, std::int32_t boot) {
    sogm_swarm::order_t message{};
    message.order = order;
    message.height = height_m;
    order_.take(message, robot_, boot);
  }

  int robot() const { return robot_; }  // -1: the swarm bus
  const std::string& url() const { return url_; }
  std::int64_t messages() const { return messages_; }

 private:
  LiveSource* source_;
  BusId bus_;
  int robot_;
  std::string url_;
  std::int64_t messages_ = 0;

  template <class T>
  struct Repeated {
    void take(const T& newest, int robot, std::int32_t boot) {
      headers.emplace(robot, boot);
      message = newest;
      times = kRepeat;
    }
    void send(Utime now, const char* channel, BusId bus, Outbox& outbox) {
      if (times == 0 || now < sent.due(now, kStep)) return;
      --times;
      sent.done(now);
      message.header = headers->next(now);
      outbox.publish(bus, channel, message);
    }
    std::optional<HeaderSource> headers;
    T message{};
    int times = 0;
    Recurring sent;
  };
  Repeated<sogm_swarm::goal_t> goal_;
  Repeated<sogm_swarm::order_t> order_;
};

class LiveSource::View : public PictureSource {
 public:
  explicit View(LiveSource* source) : source_(source) {}

  Moment now() override { return {source_->picture_, wall_utime() + source_->clock_offset_}; }

  Json describe() override {
    Json buses = Json::array();
    for (const auto& listener : source_->listeners_)
      buses.push_back({{"url", listener->url()}, {"messages", listener->messages()}});
    Json all = {{"mode", "live"}, {"buses", buses}, {"allow_goals", source_->options_.allow_goals}};
    const SwarmPicture& picture = source_->picture_;
    if (picture.newest_came() > now().utime - kLately && std::abs(picture.newest_age_s()) > kOldMessages_s) {
      all["warning"] = "The messages are " + std::to_string(std::lround(picture.newest_age_s())) +
                       " s old: a log that is played again? Then start with --replay true.";
    }
    return all;
  }

  void control(const Json& command) override {
    if (command.contains("order")) {
      const Json& order = command["order"];
      const std::int32_t boot = new_boot();  // of all robots at once, for it waits
      for (const Json& robot : order.at("robots"))
        source_->send_order(robot.get<int>(), order.at("name").get<std::string>(), order.value("height", 0.0), boot);
      return;
    }
    if (!command.contains("goal")) throw std::runtime_error("only a log can be played");
    source_->send_goal(command["goal"]);
  }

 private:
  LiveSource* source_;
};

LiveSource::LiveSource(const Options& options, RealtimeHost* host) : options_(options) {
  const HostClock clock{options.replay ? TimeSource::kMessages : TimeSource::kClock};
  const std::string swarm = swarm_bus_url(options.base_port);
  listeners_.push_back(std::make_unique<Listener>(this, BusId::kSwarm, -1, swarm));
  host->add("view", *listeners_.back(), "", swarm, clock);
  for (const int robot : options.onboard) {
    const std::string onboard = onboard_bus_url(options.base_port, robot);
    listeners_.push_back(std::make_unique<Listener>(this, BusId::kOnboard, robot, onboard));
    host->add("view", *listeners_.back(), onboard, "", clock);
  }
}

LiveSource::~LiveSource() = default;

std::unique_ptr<PictureSource> LiveSource::view() {
  return std::make_unique<View>(this);
}

void LiveSource::send_goal(const Json& goal) {
  if (!options_.allow_goals) throw std::runtime_error("goals are not allowed: start with --allow-goals true");
  const GoalOrder order = read_goal(goal);
  listener_of(order.robot_id, "goal").send_goal(order.mission, new_boot());
}

void LiveSource::send_order(int robot, const std::string& name, double height_m, std::int32_t boot) {
  if (!options_.allow_goals) throw std::runtime_error("orders are not allowed: start with --allow-goals true");
  const std::optional<std::int16_t> order = find_order(name);
  if (!order || *order == sogm_swarm::order_t::kWithout)
    throw std::runtime_error("order '" + name + "': must be take-off, hold, fly, home, land or emergency");
  const bool climbs = *order == sogm_swarm::order_t::kTakeOff;
  if (climbs && !(height_m >= kLeastClimb_m && height_m <= kMaxClimb_m))
    throw std::runtime_error("take-off: height must be within [0.1, 100] m");
  listener_of(robot, "order").send_order(*order, climbs ? height_m : 0.0, boot);
}

LiveSource::Listener& LiveSource::listener_of(int robot, const char* what) {
  for (const auto& listener : listeners_)
    if (listener->robot() == robot && robot >= 0) return *listener;
  throw std::runtime_error(std::string(what) + ": robot " + std::to_string(robot) +
                           "'s onboard bus is not listened to (--onboard)");
}

}  // namespace swarm
