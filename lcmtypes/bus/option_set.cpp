#include "lcmtypes/bus/option_set.h"

#include <algorithm>
#include <boost/program_options.hpp>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <optional>
#include <ostream>
#include <sstream>
#include <string_view>
#include <utility>

namespace swarm {
namespace {

namespace po = boost::program_options;

// Shortest text that reads back as the same number.
template <class Number>
std::string format(Number value) {
  char text[32];
  return std::string(text, std::to_chars(text, text + sizeof(text), value).ptr);
}

// The number that `text` is, if it lies within [low, high] (never true of NaN).
template <class Number>
std::optional<Number> parse_number(std::string_view text, Number low, Number high) {
  Number value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool whole = error == std::errc() && end == text.data() + text.size();
  return whole && value >= low && value <= high ? std::optional(value) : std::nullopt;
}

// The numbers of a comma-separated list, if all of them are good; an empty text is an empty list.
template <class Number>
std::optional<std::vector<Number>> parse_list(std::string_view text, Number low, Number high) {
  std::vector<Number> numbers;
  for (std::size_t begin = 0; !text.empty() && begin <= text.size();) {
    const std::size_t comma = std::min(text.find(',', begin), text.size());
    const std::size_t first = std::min(text.find_first_not_of(' ', begin), comma);
    const auto number = parse_number(text.substr(first, comma - first), low, high);
    if (!number) return std::nullopt;
    numbers.push_back(*number);
    begin = comma + 1;
  }
  return numbers;
}

template <class Numbers>
std::string format_list(const Numbers& numbers) {
  std::string text;
  for (const auto number : numbers) text.append(text.empty() ? "" : ",").append(format(number));
  return text;
}

template <class Number>
std::string range(Number low, Number high, const std::string& unit) {
  return "within [" + format(low) + ", " + format(high) + "]" + (unit.empty() ? "" : " " + unit);
}

// A config file cuts at '#' and trims: text that could not be given there is not taken anywhere.
bool fits_config(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r";
  return text.empty() || (text.find_first_of("#\n") == text.npos && kBlanks.find(text.front()) == text.npos &&
                          kBlanks.find(text.back()) == text.npos);
}

struct Given {
  std::string name, text;  // no name: a positional argument
};

void append(std::vector<Given>* given, const po::option& option, const std::string& prefix) {
  const auto same = [&](const Given& earlier) { return earlier.name == option.string_key; };
  if (!option.string_key.empty() && std::any_of(given->begin(), given->end(), same)) {
    throw OptionError(prefix + option.string_key + ": given twice");
  }
  given->push_back({option.string_key, option.value.empty() ? "" : option.value.front()});
}

std::vector<Given> read_command_line(const po::options_description& options, int argc, const char* const* argv) {
  std::vector<std::string> words;
  for (int i = 1; i < argc; ++i) {
    std::string word = argv[i] == std::string_view("-h") ? "--help" : argv[i];
    const bool empty_value = word.starts_with("--") && word.find('=') == word.size() - 1;
    if (empty_value) word.pop_back();  // "--name=", which Boost refuses, becomes "--name" ""
    words.push_back(std::move(word));
    if (empty_value) words.emplace_back();
  }
  namespace style = po::command_line_style;
  std::vector<Given> given;
  try {
    const auto parsed = po::command_line_parser(words)
                            .options(options)
                            .style(style::allow_long | style::long_allow_adjacent | style::long_allow_next)
                            .run();
    for (const auto& option : parsed.options) {
      append(&given, option, "--");
      const std::string& text = given.back().text;  // an argument may be a number below 0
      const bool is_number = text.size() > 1 && (text[1] == '.' || (text[1] >= '0' && text[1] <= '9'));
      if (option.string_key.empty() && text.starts_with('-') && !is_number)
        throw OptionError("unknown option '" + text + "'");
    }
  } catch (const po::unknown_option& error) {
    const std::string name = error.get_option_name();
    throw OptionError("unknown option '" + name.substr(0, name.find('=')) + "'");
  } catch (const po::error& error) {
    throw OptionError(error.what());
  }
  return given;
}

std::vector<Given> read_config(const po::options_description& options, const std::string& path) {
  std::ifstream file(path);
  if (!file || std::filesystem::is_directory(path)) throw OptionError(path + ": cannot be read");
  std::vector<Given> given;
  try {
    for (const auto& option : po::parse_config_file(file, options, true).options) {
      if (option.unregistered) throw OptionError(path + ": unknown key '" + option.string_key + "'");
      append(&given, option, path + ": ");
    }
  } catch (const po::invalid_syntax& error) {
    throw OptionError(path + ": '" + error.tokens() + "' is not of the form: name = value");
  } catch (const po::error& error) {
    throw OptionError(path + ": " + error.what());
  }
  return given;
}

const Given* find(const std::vector<Given>& given, std::string_view name) {
  const auto found = std::find_if(given.begin(), given.end(), [name](const Given& g) { return g.name == name; });
  return found == given.end() ? nullptr : &*found;
}

template <class Number>
std::function<bool(const std::string&)> number_setter(Number* value, Number low, Number high) {
  return [=](const std::string& text) {
    const auto number = parse_number(text, low, high);
    if (number) *value = *number;
    return number.has_value();
  };
}

}  // namespace

std::string version_line(const std::string& program) {
  return program.substr(0, program.find(' ')) + " " SWARM_VERSION;
}

OptionSet::OptionSet(std::string program, std::string usage) : program_(std::move(program)), usage_(std::move(usage)) {}

void OptionSet::add(const std::string& name, double* value, double low, double high, const std::string& unit,
                    const std::string& help) {
  entries_.push_back({name, unit, help, range(low, high, unit), false, false, number_setter(value, low, high),
                      [value] { return format(*value); }});
}

void OptionSet::add(const std::string& name, int* value, int low, int high, const std::string& unit,
                    const std::string& help) {
  entries_.push_back({name, unit, help, "a whole number " + range(low, high, unit), false, false,
                      number_setter(value, low, high), [value] { return format(*value); }});
}

void OptionSet::add(const std::string& name, Duration* value, Duration low, Duration high, const std::string& help) {
  const auto set = [=](const std::string& text) {
    const auto number = parse_number(text, low.count(), high.count());
    if (number) *value = Duration(*number);
    return number.has_value();
  };
  entries_.push_back({name, "us", help, "a whole number " + range(low.count(), high.count(), "us"), false, false, set,
                      [value] { return format(value->count()); }});
}

void OptionSet::add(const std::string& name, Eigen::Vector3d* value, double low, double high, const std::string& unit,
                    const std::string& help) {
  const auto set = [=](const std::string& text) {
    const auto numbers = parse_list(text, low, high);
    const bool good = numbers && numbers->size() == 3;
    if (good) *value = Eigen::Vector3d::Map(numbers->data());
    return good;
  };
  entries_.push_back({name, "x,y,z", help, "three numbers x,y,z, each " + range(low, high, unit), false, false, set,
                      [value] { return format_list(*value); }});
}

void OptionSet::add(const std::string& name, std::vector<int>* value, int low, int high, const std::string& help) {
  const auto set = [=](const std::string& text) {
    auto numbers = parse_list(text, low, high);
    if (numbers) *value = std::move(*numbers);
    return numbers.has_value();
  };
  entries_.push_back({name, "i,j,...", help, "whole numbers separated by commas, each " + range(low, high, ""), false,
                      false, set, [value] { return format_list(*value); }});
}

void OptionSet::add(const std::string& name, std::string* value, const std::string& help,
                    std::function<void(const std::string&)> check) {
  const auto set = [value, check = std::move(check)](const std::string& text) {
    if (!fits_config(text)) throw OptionError("must not hold '#' or line breaks, nor begin or end with a blank");
    if (check) check(text);
    *value = text;
    return true;
  };
  entries_.push_back({name, "text", help, "", false, false, set, [value] { return *value; }});
}

void OptionSet::add(const std::string& name, bool* value, const std::string& help) {
  const auto set = [value](const std::string& text) {
    *value = text == "true";
    return text == "true" || text == "false";
  };
  entries_.push_back(
      {name, "bool", help, "true or false", false, false, set, [value] { return *value ? "true" : "false"; }});
}

void OptionSet::add_positional(const std::string& name, std::string* value, const std::string& help) {
  const auto set = [value](const std::string& text) {
    *value = text;
    return !text.empty();
  };
  entries_.push_back({name, "", help, "not empty", true, false, set, [value] { return *value; }});
}

void OptionSet::add_positional(const std::string& name, std::vector<std::string>* values, const std::string& help) {
  const auto add = [values](const std::string& text) {
    values->push_back(text);
    return !text.empty();
  };
  entries_.push_back({name, "", help, "not empty", true, true, add, [] { return std::string(); }});
}

void OptionSet::assign(const Entry& entry, const std::string& text, const std::string& where) {
  bool good = false;
  try {
    good = entry.set(text);
  } catch (const OptionError& error) {
    throw OptionError(where + ": " + error.what());
  }
  if (!good) throw OptionError(where + ": must be " + entry.rule);
}

std::string OptionSet::explanation(const Entry& entry) {
  return entry.help + (entry.rule.empty() ? "" : "; " + entry.rule);
}

void OptionSet::print_help(const std::string& option_table, std::ostream& out) const {
  std::string arguments, explained;
  for (const Entry& entry : entries_) {
    if (!entry.positional) continue;
    arguments += entry.repeated ? " [" + entry.name + "...]" : " " + entry.name;
    explained += "  " + entry.name + ": " + entry.help + "\n";
  }
  out << "Usage: " << program_ << " [options]" << arguments << "\n" << usage_ << "\n" << explained << option_table;
}

OptionSet::Parsed OptionSet::parse(int argc, const char* const* argv, std::ostream& out) {
  constexpr unsigned kColumns = 120;
  po::options_description options("Options", kColumns), meta("Common to all programs", kColumns);
  for (const Entry& entry : entries_) {
    if (entry.positional) continue;
    auto* const semantic = po::value<std::string>()->value_name(entry.unit.empty() ? "number" : entry.unit);
    if (const std::string initial = entry.get(); !initial.empty()) semantic->default_value(initial);
    options.add_options()(entry.name.c_str(), semantic, explanation(entry).c_str());
  }
  auto add_meta = meta.add_options();
  add_meta("config", po::value<std::string>()->value_name("file"), "read options from it: name = value  # ...");
  add_meta("print-config", "print the options in force as a config file");
  add_meta("version", "print the version");
  add_meta("help", "print this; also -h");
  po::options_description all(kColumns);
  all.add(options).add(meta);

  const std::vector<Given> command_line = read_command_line(all, argc, argv);
  if (find(command_line, "help") != nullptr) {
    std::ostringstream table;
    table << all;
    print_help(table.str(), out);
    return Parsed::kExit;
  }
  if (find(command_line, "version") != nullptr) {
    out << version_line(program_) << "\n";
    return Parsed::kExit;
  }
  const auto entry_of = [this](const std::string& name) {
    return std::find_if(entries_.begin(), entries_.end(), [&](const Entry& entry) { return entry.name == name; });
  };
  if (const Given* config = find(command_line, "config")) {
    for (const auto& [name, text] : read_config(options, config->text)) {
      assign(*entry_of(name), text, config->text + ": " + name + " = " + text);
    }
  }
  const auto is_positional = [](const Entry& entry) { return entry.positional; };
  auto next_argument = std::find_if(entries_.begin(), entries_.end(), is_positional);
  for (const auto& [name, text] : command_line) {
    if (!name.empty()) {
      if (const auto entry = entry_of(name); entry != entries_.end()) assign(*entry, text, "--" + name + " " + text);
      continue;
    }
    if (next_argument == entries_.end()) throw OptionError("unexpected argument '" + text + "' (see --help)");
    assign(*next_argument, text, next_argument->name + " '" + text + "'");
    if (!next_argument->repeated) next_argument = std::find_if(next_argument + 1, entries_.end(), is_positional);
  }
  if (find(command_line, "print-config") != nullptr) {
    for (const Entry& entry : entries_) {
      if (!entry.positional) out << "# " << explanation(entry) << "\n" << entry.name << " = " << entry.get() << "\n";
    }
    return Parsed::kExit;
  }
  if (next_argument != entries_.end() && !next_argument->repeated)
    throw OptionError("argument " + next_argument->name + " is missing (see --help)");
  return Parsed::kRun;
}

}  // namespace swarm
