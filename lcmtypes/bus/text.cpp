#include "lcmtypes/bus/text.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <string_view>

namespace swarm {
namespace {

template <class Number>
bool read(const std::string& text, Number* number) {
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, *number);
  return error == std::errc() && stop == end && std::isfinite(static_cast<double>(*number)) && *number >= 0;
}

}  // namespace

bool read_amount(const std::string& text, double* amount) {
  return read(text, amount);
}
bool read_amount(const std::string& text, int* amount) {
  return read(text, amount);
}

std::string text_of(double value) {
  char buffer[32];
  return {buffer, std::to_chars(buffer, buffer + sizeof buffer, value).ptr};
}

std::string text_of(const Eigen::Ref<const Eigen::VectorXd>& values) {
  std::string text = "[";
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    if (i > 0) text += ',';
    text += text_of(values[i]);
  }
  text += ']';
  return text;
}

void append_fixed(double value, int decimals, std::string* text) {
  char buffer[std::numeric_limits<double>::max_exponent10 + 32];  // any double, at up to 20 decimals
  text->append(buffer, std::to_chars(buffer, buffer + sizeof buffer, value, std::chars_format::fixed, decimals).ptr);
}

std::string fixed(double value, int decimals, const std::string& unknown) {
  if (!std::isfinite(value)) return unknown;
  std::string text;
  append_fixed(value, decimals, &text);
  return text;
}

std::string aligned(const std::vector<std::vector<std::string>>& rows) {
  std::vector<std::size_t> widths(rows.front().size(), 0);
  for (const auto& row : rows) {
    for (std::size_t c = 0; c < row.size(); ++c) widths[c] = std::max(widths[c], row[c].size());
  }
  std::string text;
  for (const auto& row : rows) {
    for (std::size_t c = 0; c < row.size(); ++c) text += std::string(widths[c] - row[c].size() + 2, ' ') + row[c];
    text += '\n';
  }
  return text;
}

std::string quoted(const std::string& value) {
  constexpr std::string_view kPlain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.,:/@+-=";
  if (!value.empty() && value.find_first_not_of(kPlain) == value.npos) return value;
  std::string text = "'";
  for (const char c : value) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return text + "'";
}

std::string given_options(const NamedValues& values, const NamedValues& usual) {
  std::string line;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto& [name, value] = values[i];
    if (value != usual[i].second) line.append(" --").append(name).append(" ").append(quoted(value));
  }
  return line;
}

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts(1);
  for (const char c : text) {
    if (c == separator) {
      parts.emplace_back();
    } else {
      parts.back() += c;
    }
  }
  return parts;
}

}  // namespace swarm
