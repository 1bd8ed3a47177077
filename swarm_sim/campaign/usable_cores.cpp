#include "swarm_sim/campaign/usable_cores.h"

#include <sched.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <system_error>

#include "lcmtypes/bus/text.h"

namespace swarm {

int usable_cores() {
  std::array<cpu_set_t, 8> mask{};  // of 8192 cores, as many as Linux can have
  if (::sched_getaffinity(0, sizeof mask, mask.data()) != 0)
    throw std::system_error(errno, std::generic_category(), "sched_getaffinity");
  const int cores = CPU_COUNT_S(sizeof mask, mask.data());
  for (const char* variable : {"SLURM_CPUS_PER_TASK", "SLURM_CPUS_ON_NODE"}) {
    const char* text = std::getenv(variable);
    if (text == nullptr) continue;
    int given = 0;
    if (!read_amount(text, &given) || given < 1)
      throw std::runtime_error(std::string(variable) + ": '" + text + "' must be a number from 1 on");
    return std::min(cores, given);
  }
  return cores;
}

}  // namespace swarm
