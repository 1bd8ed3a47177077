#include "lcmtypes/bus/lcm_bus.h"

#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <stdexcept>
#include <utility>

namespace swarm {
namespace {

using std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr auto kPortion = 2ms;                        // of a drain()
constexpr auto kRejoin = 1s;                          // interfaces come and go
constexpr auto kSelfTest = 2s;                        // at most
constexpr auto kSelfTestStep = 50ms;                  // until it is sent again
constexpr char kSelfTestChannel[] = "LCM_SELF_TEST";  // liblcm's, which its programs pass over

}  // namespace

LcmBus::LcmBus(const std::string& url, SwarmKeys keys)
    : url_(UdpmUrl::parse(url)), socket_(url_), keys_(std::move(keys)), joined_(steady_clock::now()) {
  const int granted = socket_.receive_buffer();
  if (granted < url_.recv_buf_size) {
    const std::string asked = std::to_string(url_.recv_buf_size);
    warnings_.push_back("bus " + url_.to_string() + ": receive buffer of " + std::to_string(granted) +
                        " bytes instead of " + asked +
                        ", large messages may be lost; mend with: sysctl -w net.core.rmem_max=" + asked);
    url_.recv_buf_size = granted;
  }
  if (!socket_.is_routed()) {
    warnings_.push_back("bus " + url_.to_string() + ": no route for multicast, so lcm-spy, lcm-logger and other LCM " +
                        "programs cannot take part; mend with: ip route add 224.0.0.0/4 dev lo");
  }
  test_itself();
  hear_subscribed();
}

// Nobody else's messages wake this process.
void LcmBus::hear_subscribed() {
  std::vector<std::string> channels;
  for (const Subscription& subscription : subscriptions_) channels.push_back(subscription.channel);
  socket_.hear_only(channels);
}

// A firewall is silent: only what is heard was let through.
void LcmBus::test_itself() {
  const auto end = steady_clock::now() + kSelfTest;
  const std::array<std::uint8_t, 4> own{static_cast<std::uint8_t>(::getpid()),
                                        static_cast<std::uint8_t>(::getpid() >> 8), static_cast<std::uint8_t>(fd()),
                                        0xa5};
  for (auto again = steady_clock::now(); steady_clock::now() < end;) {
    if (steady_clock::now() >= again) {
      (void)publish(kSelfTestChannel, own);
      again = steady_clock::now() + kSelfTestStep;
    }
    while (const auto datagram = socket_.receive()) {
      const auto message = reader_.read(datagram->sender, datagram->bytes);
      if (message && message->channel == kSelfTestChannel && std::ranges::equal(without_seal(message->bytes), own))
        return;
      if (steady_clock::now() >= end) break;
    }
    pollfd pending{fd(), POLLIN, 0};
    ::poll(&pending, 1, 10);
  }
  throw std::runtime_error("bus " + url_.to_string() +
                           ": hears nothing of what it sends; is the interface up (ip link " +
                           "set lo up), and does a firewall block UDP port " + std::to_string(url_.port) + "?");
}

void LcmBus::join_again() {
  const auto now = steady_clock::now();
  if (now - joined_ < kRejoin) return;
  joined_ = now;
  socket_.join();
}

void LcmBus::subscribe(const std::string& channel, Handler handler) {
  const auto plain = [](unsigned char c) { return std::isalnum(c) != 0 || c == '_'; };
  if (channel.empty() || channel.size() > kMaxLcmChannel || !std::ranges::all_of(channel, plain)) {
    throw std::invalid_argument("channel '" + channel + "': must be 1 to " + std::to_string(kMaxLcmChannel) +
                                " letters, digits or '_'");
  }
  subscriptions_.push_back({channel, std::move(handler)});
  hear_subscribed();
}

void LcmBus::unsubscribe(std::string_view channel) {
  std::erase_if(subscriptions_, [=](const Subscription& subscription) { return subscription.channel == channel; });
  hear_subscribed();
}

bool LcmBus::publish(std::string_view channel, std::span<const std::uint8_t> bytes) {
  join_again();
  if (!keys_.empty()) {
    sealed_.assign(bytes.begin(), bytes.end());
    keys_.seal(channel, &sealed_);
    bytes = sealed_;
  }
  return write_lcm(sent_++, {channel, bytes},
                   [this](const auto& head, const auto& payload) { return socket_.send(head, payload); });
}

int LcmBus::drain() {
  join_again();
  int handled = 0;
  for (const auto end = steady_clock::now() + kPortion; steady_clock::now() < end;) {
    const auto datagram = socket_.receive();
    if (!datagram) break;
    const auto message = reader_.read(datagram->sender, datagram->bytes);
    if (!message) continue;
    const auto is_of = [&](const Subscription& subscription) { return subscription.channel == message->channel; };
    if (std::ranges::none_of(subscriptions_, is_of)) continue;
    ++handled;
    if (!keys_.empty() && !keys_.opens(message->channel, message->bytes)) {
      ++forged_;
      continue;
    }
    for (const Subscription& subscription : subscriptions_) {
      if (is_of(subscription)) subscription.handler(message->channel, without_seal(message->bytes));
    }
  }
  return handled;
}

}  // namespace swarm
