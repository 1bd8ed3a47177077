#include "swarm_sim/world/imperfections.h"

namespace swarm {

std::string listed(std::span<const char* const> words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i)
    text.append(i == 0 ? "" : i + 1 == words.size() ? " or " : ", ").append(words[i]);
  return text;
}

}  // namespace swarm
