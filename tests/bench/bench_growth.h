// How the time of a plan grows with the work.
#pragma once

#include <string>

namespace swarm {

// Times plans among random obstacles, varying the number of obstacles and of peers, the horizon and the resolution one
// at a time. Prints a table with the exponent of each, and writes the same to `csv_path` (whole or not at all). Throws
// std::runtime_error with the path when it cannot be written.
void measure_growth(const std::string& csv_path);

}  // namespace swarm
