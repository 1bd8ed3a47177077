// The daemons under a service manager: what they tell it, and what it notices when one hangs.
#include "lcmtypes/bus/service_manager.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <chrono>
#include <csignal>
#include <optional>
#include <string>
#include <vector>

#include "tests/support/harness.h"

namespace swarm::test {
namespace {

using std::chrono::steady_clock;

constexpr Duration kHung = 300ms;  // what a daemon may be silent for

// The socket that a service manager listens to.
class Listener {
 public:
  Listener() : path_((directory_ / "notify").string()) {
    socket_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path_.copy(address.sun_path, sizeof(address.sun_path) - 1);
    EXPECT_EQ(::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  }
  ~Listener() { ::close(socket_); }

  // What is said next; nothing when that takes longer.
  std::optional<std::string> hear(Duration within) const {
    pollfd wanted{socket_, POLLIN, 0};
    if (::poll(&wanted, 1, static_cast<int>(within / 1ms)) != 1) return {};
    std::string text(256, '\0');
    text.resize(static_cast<std::size_t>(std::max<ssize_t>(0, ::recv(socket_, text.data(), text.size(), 0))));
    return text;
  }
  const std::string& path() const { return path_; }

 private:
  TemporaryDirectory directory_;
  std::string path_;
  int socket_ = -1;
};

std::vector<std::string> command(const std::string& daemon, const std::vector<std::string>& environment) {
  std::vector<std::string> words = {"/usr/bin/env"};
  words.insert(words.end(), environment.begin(), environment.end());
  words.push_back(std::string(SWARM_BIN_DIR) + "/" + daemon);
  const std::string port = ":" + std::to_string(base_port());
  words.push_back("--onboard-url=udpm://239.255.76.67" + port + "?ttl=0");
  if (daemon == "broadcast_daemon") {
    words.insert(words.end(), {"--insecure=true", "--roster=0",
                               "--swarm-url=udpm://239.255.76.68:" + std::to_string(base_port() + 33) + "?ttl=0"});
  }
  return words;
}

TEST(ServiceManager, HearsThatADaemonRunsAndThatItHangs) {
  for (const char* daemon : {"map_daemon", "planner_daemon", "broadcast_daemon"}) {
    SCOPED_TRACE(daemon);
    const Listener listener;
    Program program(
        command(daemon, {"NOTIFY_SOCKET=" + listener.path(), "WATCHDOG_USEC=" + std::to_string(kHung.count())}));
    ASSERT_EQ(listener.hear(5s), "READY=1") << program.err();
    for (int i = 0; i < 6; ++i) ASSERT_EQ(listener.hear(kHung), "WATCHDOG=1") << i;
    program.signal(SIGSTOP);
    while (listener.hear(50ms)) {  // what was said before
    }
    EXPECT_EQ(listener.hear(2 * kHung), std::nullopt);
    program.signal(SIGCONT);
    EXPECT_EQ(listener.hear(kHung), "WATCHDOG=1");
    program.signal(SIGTERM);
    EXPECT_EQ(program.wait(3.0), 0) << program.err();
  }
}

TEST(ServiceManager, IsToldNoMoreThanItAskedFor) {
  const std::string watched = "WATCHDOG_USEC=" + std::to_string(kHung.count());
  for (const std::vector<std::string>& environment :
       std::vector<std::vector<std::string>>{{}, {watched, "WATCHDOG_PID=1"}, {"WATCHDOG_USEC=soon"}}) {
    const Listener listener;
    auto with_socket = environment;
    with_socket.push_back("NOTIFY_SOCKET=" + listener.path());
    Program program(command("map_daemon", with_socket));
    ASSERT_EQ(listener.hear(5s), "READY=1") << program.err();
    EXPECT_EQ(listener.hear(kHung), std::nullopt);
  }
  // A socket that cannot be is no reason not to fly.
  for (const std::string& path :
       {std::string("relative"), std::string("/no/such/socket"), "/" + std::string(200, 'x')}) {
    Program program(command("map_daemon", {"NOTIFY_SOCKET=" + path, watched}));
    EXPECT_EQ(program.wait(0.5), std::nullopt) << program.err();
  }
}

}  // namespace
}  // namespace swarm::test
