// Strict reading of JSON: every value knows where it stands, and what is wrong is told in one line.
#pragma once

#include <Eigen/Core>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace swarm {

// Parses strict JSON; a key given twice in one object is refused too. Throws WorldError.
nlohmann::json parse_json(const std::string& text);

// A value and its path, e.g. obstacles[3].diameter. All members throw WorldError "path: value must be rule".
class JsonValue {
 public:
  enum class Low { kIncluded, kExcluded };

  explicit JsonValue(const nlohmann::json& json, std::string path = "") : json_(json), path_(std::move(path)) {}

  void require_object() const;
  // This must be an object with no other keys than these.
  void expect_keys(std::initializer_list<const char*> keys) const { expect_keys(std::span(keys.begin(), keys.size())); }
  void expect_keys(std::span<const char* const> keys) const;
  JsonValue at(const std::string& key) const;  // must be there
  std::optional<JsonValue> find(const std::string& key) const;
  std::vector<JsonValue> items() const;  // of an array

  // A number, finite and in [low, high], or (low, high] with Low::kExcluded.
  double number(double low, double high, Low open = Low::kIncluded) const;
  int integer(int low, int high) const;  // 1 and 1.0 are both fine
  Eigen::VectorXd numbers(int size, double low, double high, Low open = Low::kIncluded) const;
  std::string text(std::size_t max_length) const;  // not empty, no control characters

  [[noreturn]] void fail(const std::string& rule) const;

 private:
  const nlohmann::json& json_;
  std::string path_;
};

}  // namespace swarm
