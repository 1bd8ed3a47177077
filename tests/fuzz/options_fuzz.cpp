// Command lines and config files: they are taken or refused with one line, values keep their rules, and what
// --print-config says reads back as the same values.
#include <sstream>

#include "lcmtypes/bus/option_set.h"
#include "tests/fuzz/fuzz_input.h"

namespace swarm::fuzz {
namespace {

struct Values {
  double real = 1.5;
  int whole = 3;
  Duration duration = 20ms;
  Eigen::Vector3d vector{1, 2, 3};
  std::vector<int> list{1, 2};
  std::string text = "some", checked = "ok";
  bool flag = false;
  std::string first;
  std::vector<std::string> others;
};

OptionSet::Parsed parse(const std::vector<std::string>& words, Values* values, std::ostream& out) {
  OptionSet options("program command", "Does nothing.");
  options.add("real", &values->real, -10, 1e6, "m", "a number");
  options.add("whole", &values->whole, -5, 32767, "", "a whole number");
  options.add("duration", &values->duration, 10ms, 10s, "a duration");
  options.add("vector", &values->vector, -1e5, 1e5, "m", "a vector");
  options.add("list", &values->list, 0, 32767, "a list");
  options.add("text", &values->text, "a text");
  options.add("checked", &values->checked, "a text that is checked", [](const std::string& text) {
    if (text.size() > 4) throw OptionError("must be short");
  });
  options.add("flag", &values->flag, "a flag");
  options.add_positional("first", &values->first, "an argument");
  options.add_positional("others", &values->others, "more of them");
  std::vector<const char*> arguments{"program"};
  for (const std::string& word : words) arguments.push_back(word.c_str());
  return options.parse(static_cast<int>(arguments.size()), arguments.data(), out);
}

void check(const Values& values) {
  expect(values.real >= -10 && values.real <= 1e6 && values.whole >= -5 && values.whole <= 32767, "numbers keep rules");
  expect(values.duration >= 10ms && values.duration <= 10s, "durations do");
  expect(values.vector.cwiseAbs().maxCoeff() <= 1e5, "vectors do");
  for (const int number : values.list) expect(number >= 0 && number <= 32767, "lists do");
  expect(values.checked.size() <= 4, "texts are checked");
}

}  // namespace
}  // namespace swarm::fuzz

// The config file, then the words of the command line, one a line.

namespace swarm::fuzz {

void try_input(FuzzInput input) {
  const auto config = input.part();
  const MemoryFile file(config);
  std::vector<std::string> words;
  if (!config.empty()) words = {"--config", file.path()};
  std::istringstream lines{std::string(text_of(input.rest()))};
  for (std::string line; std::getline(lines, line);) words.push_back(line.substr(0, line.find('\0')));

  Values values;
  std::ostringstream out;
  try {
    if (parse(words, &values, out) == OptionSet::Parsed::kExit) {
      expect(!out.str().empty(), "something was printed");
      return;
    }
  } catch (const OptionError& error) {
    expect(*error.what() != '\0', "it is said why");
    return;
  }
  check(values);
  expect(!values.first.empty(), "no argument is missing");

  words.insert(words.begin(), "--print-config");
  std::ostringstream printed;
  Values same;
  expect(parse(words, &same, printed) == OptionSet::Parsed::kExit, "the same words print a config file");
  const std::string text = printed.str();
  const MemoryFile again({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  Values read;
  expect(parse({"--config", again.path(), "first"}, &read, out) == OptionSet::Parsed::kRun, "it reads back");
  expect(read.real == values.real && read.whole == values.whole && read.duration == values.duration &&
             read.vector == values.vector && read.list == values.list && read.text == values.text &&
             read.checked == values.checked && read.flag == values.flag,
         "as the same values");
}

}  // namespace swarm::fuzz
