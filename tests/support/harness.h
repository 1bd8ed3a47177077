// What the tests of nodes and programs share: messages as sensors and peers send them, a mailbox for what a node says,
// and programs started and ended as an operator does.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <optional>
#include <set>
#include <sstream>
#include <string>
#include <string_view>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "lcmtypes/bus/node.h"
#include "lcmtypes/bus/packed_announcement.h"
#include "lcmtypes/bus/temporary_directory.h"
#include "lcmtypes/bus/time.h"
#include "planner_daemon/trajectory/trajectory.h"
#include "tests/support/quintic_to.h"
#include "tests/support/start_time.h"

namespace swarm::test {

#if defined(__SANITIZE_ADDRESS__)
inline constexpr bool kSanitized = true;  // slow: no promises about time
#else
inline constexpr bool kSanitized = false;
#endif
inline constexpr double kPatience = kSanitized ? 10.0 : 1.0;  // how much longer what programs do may take

using Bytes = std::vector<std::uint8_t>;

template <class T>
Bytes encoded(const T& message) {
  Bytes bytes;
  encode(message, &bytes);
  return bytes;
}
inline Bytes packed(sogm_swarm::announcement_t message) {
  Bytes bytes;
  encode_packed(&message, &bytes);
  return bytes;
}
// As it travels on the channel: announcements are packed on the swarm bus.
template <class T>
Bytes encoded_for(std::string_view channel, const T& message) {
  if constexpr (std::is_same_v<T, sogm_swarm::announcement_t>) {
    if (channel == channel::kAnnouncement) return packed(message);
  }
  return encoded(message);
}
template <class T>
Refusal decode_from(std::string_view channel, std::span<const std::uint8_t> bytes, T* message) {
  if constexpr (std::is_same_v<T, sogm_swarm::announcement_t>) {
    if (channel == channel::kAnnouncement) return decode_packed(bytes, message);
  }
  return decode(bytes, message);
}

inline sogm_swarm::header_t make_header(int robot_id, std::int32_t boot, std::int64_t seq, Utime utime) {
  sogm_swarm::header_t header{};
  header.schema_version = sogm_swarm::header_t::kSchemaVersion;
  header.robot_id = static_cast<std::int16_t>(robot_id);
  header.boot = boot;
  header.seq = seq;
  header.utime = to_us(utime);
  return header;
}

inline sogm_swarm::robot_state_t state_at(int id, const Eigen::Vector3d& position, std::int64_t seq, Utime utime) {
  sogm_swarm::robot_state_t state{};
  state.header = make_header(id, 1, seq, utime);
  Eigen::Map<Eigen::Vector3d>(state.position) = position;
  return state;
}

// What a node has said, in order.
class Mailbox : public Outbox {
 public:
  struct Letter {
    BusId bus;
    std::string channel;
    Bytes bytes;
  };

  void publish_bytes(BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes) override {
    letters.push_back({bus, std::string(channel), {bytes.begin(), bytes.end()}});
  }
  void listen(BusId, std::string_view channel, bool listens) override {
    listens ? void(heard.insert(std::string(channel))) : void(heard.erase(std::string(channel)));
  }

  // Everything of one channel, which must decode.
  template <class T>
  std::vector<T> all(std::string_view channel, BusId bus = BusId::kOnboard) const {
    std::vector<T> messages;
    for (const Letter& letter : letters) {
      if (letter.bus != bus || letter.channel != channel) continue;
      const Refusal refusal = decode_from(channel, letter.bytes, &messages.emplace_back());
      EXPECT_EQ(refusal, Refusal::kNone) << channel << ": " << to_string(refusal);
    }
    return messages;
  }
  template <class T>
  T newest(std::string_view channel, BusId bus = BusId::kOnboard) const {
    const std::vector<T> messages = all<T>(channel, bus);
    EXPECT_FALSE(messages.empty()) << "nothing on " << channel;
    return messages.empty() ? T{} : messages.back();
  }
  int count(std::string_view channel, BusId bus = BusId::kOnboard) const {
    return static_cast<int>(std::count_if(letters.begin(), letters.end(), [&](const Letter& letter) {
      return letter.bus == bus && letter.channel == channel;
    }));
  }

  std::vector<Letter> letters;
  std::set<std::string> heard;  // channels beside its subscriptions
};

// A node in simulated time, called as the hosts call it: messages, then a step; and a step whenever it asked for one.
template <class NodeType>
class Bench {
 public:
  template <class... Arguments>
  explicit Bench(Arguments&&... arguments) : node(std::forward<Arguments>(arguments)...) {
    step();
  }

  void step() {
    ++steps;
    if (wall_ahead != 0us && node.on_clock_step(now, wall_ahead)) now += std::exchange(wall_ahead, Duration());
    wake = node.step(now, out);
  }
  void deliver(BusId bus, std::string_view channel, std::span<const std::uint8_t> bytes) {
    node.on_message(now, bus, channel, bytes, out);
    step();
  }
  template <class T>
  void send(std::string_view channel, const T& message, BusId bus = BusId::kOnboard) {
    deliver(bus, channel, encoded_for(channel, message));
  }
  void run_until(Utime utime) {
    while (wake <= utime) {
      ASSERT_GT(wake, now) << "the node asks for a step in the past";
      now = wake;
      step();
    }
    now = utime;
  }
  void run_for(double seconds) { run_until(now + to_duration(seconds)); }

  Utime now = kStart, wake{};
  Duration wall_ahead{};  // the wall clock was stepped by this: the node is asked until it agrees
  int steps = 0;
  Mailbox out;
  NodeType node;
};

inline std::string read_text(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  EXPECT_TRUE(in) << path;
  return {std::istreambuf_iterator<char>(in), {}};
}
// With `to` instead of `from`, which is there.
inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, text.npos) << from;
  return at == text.npos ? text : text.replace(at, from.size(), to);
}
inline std::filesystem::path write_text(const std::filesystem::path& path, std::string_view text) {
  std::ofstream(path, std::ios::binary) << text;
  return path;
}

// True as soon as `condition` is; false after `seconds`.
inline bool wait_for(double seconds, const std::function<bool()>& condition) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(10ms);
  }
  return true;
}

// A program of this project, or any by its path, running. It ends with this object at the latest.
class Program {
 public:
  explicit Program(const std::vector<std::string>& words) {
    std::vector<std::string> copy = words;
    if (!copy.front().starts_with('/')) {
      copy.front().insert(0, SWARM_BIN_DIR "/");
      std::istringstream emulator(SWARM_EMULATOR);  // needed where this test is emulated, too
      copy.insert(copy.begin(), std::istream_iterator<std::string>(emulator), {});
    }
    std::vector<char*> argv;
    for (std::string& word : copy) argv.push_back(word.data());
    argv.push_back(nullptr);
    const std::string out = write_text(output_ / "out", ""), err = write_text(output_ / "err", "");
    pid_ = ::fork();
    if (pid_ == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      ::dup2(::open("/dev/null", O_RDONLY), STDIN_FILENO);
      ::dup2(::open(out.c_str(), O_WRONLY), STDOUT_FILENO);
      ::dup2(::open(err.c_str(), O_WRONLY), STDERR_FILENO);
      ::execvp(argv[0], argv.data());
      ::_exit(127);
    }
  }
  ~Program() {
    signal(SIGTERM);
    if (!wait(3.0)) signal(SIGKILL), wait(3.0);
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  void signal(int number) const {
    if (!exit_code_) ::kill(pid_, number);
  }
  // The exit code, minus the number of the signal that killed it, or nothing while it runs.
  std::optional<int> wait(double seconds) {
    int status = 0;
    wait_for(seconds, [&] {
      if (!exit_code_ && ::waitpid(pid_, &status, WNOHANG) == pid_) {
        exit_code_ = WIFSIGNALED(status) ? -WTERMSIG(status) : WEXITSTATUS(status);
      }
      return exit_code_.has_value();
    });
    return exit_code_;
  }
  bool running() { return !wait(0.0); }
  pid_t pid() const { return pid_; }
  std::string out() const { return read_text(output_ / "out"); }
  std::string err() const { return read_text(output_ / "err"); }

 private:
  TemporaryDirectory output_;
  pid_t pid_ = -1;
  std::optional<int> exit_code_;
};

struct Finished {
  int exit_code = 0;
  std::string out, err;
};
inline Finished run_program(const std::vector<std::string>& words, double seconds = 20.0) {
  Program program(words);
  const std::optional<int> exit_code = program.wait(seconds);
  EXPECT_TRUE(exit_code) << words.front() << " runs for ever";
  return {exit_code.value_or(-1), program.out(), program.err()};
}

// Processes whose command line holds `text`; ended ones that nobody has waited for do not count.
inline std::vector<pid_t> processes_with(const std::string& text) {
  std::vector<pid_t> found;
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator("/proc", ignored)) {
    const std::string name = entry.path().filename();
    if (!std::all_of(name.begin(), name.end(), [](unsigned char c) { return std::isdigit(c) != 0; })) continue;
    std::ifstream in(entry.path() / "cmdline", std::ios::binary);  // empty for zombies
    const std::string line{std::istreambuf_iterator<char>(in), {}};
    if (line.find(text) != std::string::npos && std::stoi(name) != ::getpid()) found.push_back(std::stoi(name));
  }
  return found;
}

// Ports [base, base + 140) for this test's own use: tests that run at the same time have other process ids.
inline int base_port() {
  return 20000 + static_cast<int>(::getpid() % 85) * 140;
}
inline std::string local_url(int port) {
  return "udpm://239.255.76.67:" + std::to_string(port) + "?ttl=0";
}

}  // namespace swarm::test
