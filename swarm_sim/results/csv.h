// Comma-separated values after RFC 4180: one record a line; cells with commas or quotes are quoted.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace swarm {

// Cells must not hold line breaks, else std::invalid_argument. No line break at the end.
std::string csv_line(const std::vector<std::string>& cells);

// Cells of one line, without its line break. Throws std::invalid_argument when a quote is not closed.
std::vector<std::string> csv_cells(std::string_view line);

}  // namespace swarm
