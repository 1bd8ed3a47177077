#include "swarm_sim/hosts/supervisor.h"

#include <fcntl.h>
#include <sched.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>

namespace swarm {

InNamespace::InNamespace(const std::string& name) {
  if (name.empty()) return;
  home_ = ::open("/proc/self/ns/net", O_RDONLY | O_CLOEXEC);
  const std::string path = "/run/netns/" + name;
  const int there = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool entered = there >= 0 && ::setns(there, CLONE_NEWNET) == 0;
  const std::string reason = std::strerror(errno);
  if (there >= 0) ::close(there);
  if (entered) return;
  ::close(home_);
  throw std::runtime_error(path + ": cannot be entered: " + reason);
}

InNamespace::~InNamespace() {
  if (home_ < 0) return;
  (void)::setns(home_, CLONE_NEWNET);
  ::close(home_);
}

void DaemonProgram::start(ChildProcesses& children) const {
  const InNamespace there(netns);
  children.start(name, program, arguments, log);
}

void Supervised::follow(double t_s, ChildProcesses& children) {
  if (!was_down_ && t_s >= kill_.at_s) {
    is_down_ = was_down_ = true;
    children.kill(daemon_.name);
  } else if (is_down_ && t_s >= kill_.back_s) {
    is_down_ = false;
    daemon_.start(children);
  }
}

}  // namespace swarm
