// Child processes that never outlive their owner: not its end, not an exception, not its crash.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace swarm {

class ChildProcesses {
 public:
  ChildProcesses() = default;
  ~ChildProcesses();  // ends those that run: SIGTERM, and SIGKILL for what is left after a second
  ChildProcesses(const ChildProcesses&) = delete;
  ChildProcesses& operator=(const ChildProcesses&) = delete;

  // Starts `program` with `arguments`; its output is added to `log`. It gets SIGTERM when this process dies in whatever
  // way, and ignores the terminal's Ctrl-C, which is the owner's to handle. Throws std::runtime_error.
  void start(const std::string& name, const std::filesystem::path& program, const std::vector<std::string>& arguments,
             const std::filesystem::path& log);

  // Ends the child of that name with SIGKILL, as a crash would; it may be started again.
  void kill(const std::string& name);

  // From now on processor time counts.
  void begin_processor_time();
  // Of the child of that name, since then or since it was started [s]; 0: it does not run.
  double processor_s(const std::string& name) const;

  // One line about a child that has ended since the start ("robot 2's map_daemon: killed by signal 9 (Killed); its last
  // words: ..."), if any.
  std::optional<std::string> find_ended();

 private:
  struct Child {
    pid_t pid;
    std::string name;
    std::filesystem::path log;
    double idle_s = 0.0;  // processor time before it counted

    double processor_s() const;
  };
  std::vector<Child> children_;
};

}  // namespace swarm
