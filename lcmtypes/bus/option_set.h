// Options of a program: command line, config file, --help, --print-config and --version from one declaration.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <iosfwd>
#include <stdexcept>
#include <string>
#include <vector>

#include "lcmtypes/bus/time.h"

namespace swarm {

// What is wrong with the options: one line with name, value and rule. Programs print it and exit with code 2.
struct OptionError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// "PROGRAM 0.2.0": the first word of `program` (not its sub-command) and the version of all programs of this tree.
std::string version_line(const std::string& program);

// Declares options that write into a config struct; the struct's initial values are the defaults. All over
// Boost.Program_options. An option is `name` on the command line (--name VALUE) and in the config file (name = VALUE).
class OptionSet {
 public:
  enum class Parsed { kRun, kExit };  // kExit: --help, --version or --print-config was printed

  // `usage`: what the program does, shown above the options.
  OptionSet(std::string program, std::string usage);

  // Numbers must be finite and within [low, high]; `unit` as "m", "Hz", "" ...
  void add(const std::string& name, double* value, double low, double high, const std::string& unit,
           const std::string& help);
  void add(const std::string& name, int* value, int low, int high, const std::string& unit, const std::string& help);
  // Given in whole microseconds.
  void add(const std::string& name, Duration* value, Duration low, Duration high, const std::string& help);
  // Given as "x,y,z".
  void add(const std::string& name, Eigen::Vector3d* value, double low, double high, const std::string& unit,
           const std::string& help);
  // Comma-separated list of integers, e.g. robot ids; may be empty.
  void add(const std::string& name, std::vector<int>* value, int low, int high, const std::string& help);
  // Text without '#' and without blanks at its ends, which a config file cannot hold; `check` throws OptionError or
  // returns.
  void add(const std::string& name, std::string* value, const std::string& help,
           std::function<void(const std::string&)> check = nullptr);
  void add(const std::string& name, bool* value, const std::string& help);  // true/false
  // A positional argument, required.
  void add_positional(const std::string& name, std::string* value, const std::string& help);
  // Any number of positional arguments, none as well; after all others.
  void add_positional(const std::string& name, std::vector<std::string>* values, const std::string& help);

  // Command line wins over --config FILE wins over defaults. Unknown names, repeated or malformed values throw
  // OptionError. --help, --version and --print-config go to `out`; the last prints a valid config file.
  Parsed parse(int argc, const char* const* argv, std::ostream& out);

 private:
  struct Entry {
    std::string name, unit, help, rule;
    bool positional = false, repeated = false;
    std::function<bool(const std::string&)> set;  // false: against the rule; OptionError: against a check
    std::function<std::string()> get;
  };
  static std::string explanation(const Entry& entry);
  static void assign(const Entry& entry, const std::string& text, const std::string& where);
  void print_help(const std::string& option_table, std::ostream& out) const;

  std::string program_, usage_;
  std::vector<Entry> entries_;
};

}  // namespace swarm
