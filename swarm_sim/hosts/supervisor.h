// Starts a robot's daemons, wherever its network is, and starts them again after a crash that was asked for.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "swarm_sim/hosts/child_processes.h"
#include "swarm_sim/hosts/faults.h"

namespace swarm {

// As long as it lives this thread is in a network namespace: sockets and children made meanwhile stay in there.
class InNamespace {
 public:
  // Empty: where it is. Throws std::runtime_error with path and reason.
  explicit InNamespace(const std::string& name);
  ~InNamespace();
  InNamespace(const InNamespace&) = delete;
  InNamespace& operator=(const InNamespace&) = delete;

 private:
  int home_ = -1;
};

struct DaemonProgram {
  std::string name;
  std::filesystem::path program;
  std::vector<std::string> arguments;
  std::filesystem::path log;
  std::string netns;  // empty: this one

  void start(ChildProcesses& children) const;
};

// A daemon that crashes in flight, and is started again.
class Supervised {
 public:
  // `daemon` must outlive it.
  Supervised(const Kill& kill, const DaemonProgram& daemon) : kill_(kill), daemon_(daemon) {}
  // Does what is due at world time `t_s`.
  void follow(double t_s, ChildProcesses& children);

 private:
  Kill kill_;
  const DaemonProgram& daemon_;
  bool is_down_ = false, was_down_ = false;
};

}  // namespace swarm
