#include "swarm_sim/hosts/child_processes.h"

#include <fcntl.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <stdexcept>
#include <thread>

namespace swarm {
namespace {

std::string last_line(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::string last;
  for (std::string line; std::getline(in, line);) {
    if (!line.empty()) last = line;
  }
  return last;
}

}  // namespace

void ChildProcesses::start(const std::string& name, const std::filesystem::path& program,
                           const std::vector<std::string>& arguments, const std::filesystem::path& log) {
  const int output = ::open(log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (output < 0) throw std::runtime_error(log.string() + ": " + ::strerror(errno));
  std::vector<std::string> words = arguments;
  words.insert(words.begin(), program.string());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);

  const pid_t parent = ::getpid();
  const pid_t pid = ::fork();
  if (pid < 0) {
    ::close(output);
    throw std::runtime_error(name + ": fork: " + ::strerror(errno));
  }
  if (pid == 0) {  // only async-signal-safe calls from here to exec
    ::setpgid(0, 0);
    ::prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (::getppid() != parent) ::_exit(127);  // it died before the line above
    ::dup2(output, STDOUT_FILENO);
    ::dup2(output, STDERR_FILENO);
    ::execv(program.c_str(), argv.data());
    const char* const reason = ::strerror(errno);
    (void)!::write(STDERR_FILENO, reason, ::strlen(reason));
    ::_exit(127);
  }
  ::close(output);
  children_.push_back({.pid = pid, .name = name, .log = log});
}

void ChildProcesses::kill(const std::string& name) {
  const auto child = std::ranges::find(children_, name, &Child::name);
  if (child == children_.end()) return;
  ::kill(child->pid, SIGKILL);
  ::waitpid(child->pid, nullptr, 0);
  children_.erase(child);
}

double ChildProcesses::Child::processor_s() const {
  clockid_t clock{};
  timespec time{};
  if (::clock_getcpuclockid(pid, &clock) != 0 || ::clock_gettime(clock, &time) != 0) return idle_s;
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

void ChildProcesses::begin_processor_time() {
  for (Child& child : children_) child.idle_s = child.processor_s();
}

double ChildProcesses::processor_s(const std::string& name) const {
  const auto child = std::ranges::find(children_, name, &Child::name);
  return child == children_.end() ? 0.0 : child->processor_s() - child->idle_s;
}

std::optional<std::string> ChildProcesses::find_ended() {
  for (auto child = children_.begin(); child != children_.end(); ++child) {
    int status = 0;
    if (::waitpid(child->pid, &status, WNOHANG) != child->pid) continue;
    const std::string how = WIFSIGNALED(status) ? "killed by signal " + std::to_string(WTERMSIG(status)) + " (" +
                                                      ::strsignal(WTERMSIG(status)) + ")"
                                                : "ended with exit code " + std::to_string(WEXITSTATUS(status));
    const std::string words = last_line(child->log);
    const std::string text = child->name + ": " + how + (words.empty() ? "" : "; its last words: " + words);
    children_.erase(child);
    return text;
  }
  return std::nullopt;
}

ChildProcesses::~ChildProcesses() {
  for (const Child& child : children_) ::kill(child.pid, SIGTERM);
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(1);
  for (const Child& child : children_) {
    while (::waitpid(child.pid, nullptr, WNOHANG) == 0) {
      if (std::chrono::steady_clock::now() > deadline) {
        ::kill(child.pid, SIGKILL);
        ::waitpid(child.pid, nullptr, 0);
        break;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  }
}

}  // namespace swarm
