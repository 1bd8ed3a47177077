// Numbers and tables as text. A number is the shortest text that reads back as the same double, whatever the locale.
#pragma once

#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

namespace swarm {

std::string text_of(double value);                                     // 1.5
std::string text_of(const Eigen::Ref<const Eigen::VectorXd>& values);  // [1,2.5,0]
void append_fixed(double value, int decimals, std::string* text);      // always `decimals` digits after the point
std::string fixed(double value, int decimals, const std::string& unknown = "-");  // the same; of what is not finite

// All of `text` as one finite number >= 0; false: it is none.
bool read_amount(const std::string& text, double* amount);
bool read_amount(const std::string& text, int* amount);

// As one word of a shell's line: in quotes where it must be.
std::string quoted(const std::string& value);

// What stands between the separators: one part more than there are of them.
std::vector<std::string> split(const std::string& text, char separator);

// Options of a command line: " --name value" for each value that differs from the usual one; both in the same order.
using NamedValues = std::vector<std::pair<std::string, std::string>>;
std::string given_options(const NamedValues& values, const NamedValues& usual);

// Rows of right-aligned columns, each as wide as its widest cell. All rows have as many cells; at least one row.
std::string aligned(const std::vector<std::vector<std::string>>& rows);

}  // namespace swarm
