// Stored problems of the trajectory optimisation, one JSON line each, as `planner_bench --problems` takes them.
#pragma once

#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "planner_daemon/optimize/spline_qp.h"

namespace swarm {

struct StoredQp {
  nlohmann::json json;  // the whole line
  std::string name;
  int degree = 0;
  std::vector<double> durations_s;
  SplineProblem problem;
};

// {"name", "degree", "durations_s": [...], "v_max", "a_max", "start": {"p", "v", "a"}, "end": {...},
//  "corridors": [{"A": [[x, y, z], ...], "b": [...]}, ...]}; A x <= b, one corridor per piece. Throws
// std::runtime_error with path, line number and reason.
inline std::vector<StoredQp> read_qp_problems(const std::string& path) {
  std::ifstream in(path);
  if (!in) throw std::runtime_error(path + ": cannot be read");
  const auto vector = [](const nlohmann::json& j) {
    if (j.size() != 3) throw std::runtime_error("a vector must have 3 components, has " + std::to_string(j.size()));
    return Eigen::Vector3d(j.at(0), j.at(1), j.at(2));
  };
  const auto state = [&](const nlohmann::json& j) {
    return EndState{vector(j.at("p")), vector(j.at("v")), vector(j.at("a"))};
  };
  std::vector<StoredQp> problems;
  int number = 0;
  for (std::string line; std::getline(in, line);) {
    ++number;
    if (line.empty()) continue;
    try {
      StoredQp stored;
      stored.json = nlohmann::json::parse(line);
      const nlohmann::json& j = stored.json;
      stored.name = j.at("name");
      stored.degree = j.at("degree");
      stored.durations_s = j.at("durations_s").get<std::vector<double>>();
      stored.problem = {state(j.at("start")), state(j.at("end")), j.at("v_max"), j.at("a_max"), {}};
      for (const nlohmann::json& corridor : j.at("corridors")) {
        Polytope& polytope = stored.problem.corridors.emplace_back();
        const nlohmann::json &normals = corridor.at("A"), &offsets = corridor.at("b");
        if (normals.size() != offsets.size()) throw std::runtime_error("A and b must have as many rows");
        if (normals.size() > Polytope::kMaxFaces)
          throw std::runtime_error("a corridor has " + std::to_string(normals.size()) + " faces, at most " +
                                   std::to_string(Polytope::kMaxFaces));
        polytope.normals.resize(static_cast<Eigen::Index>(normals.size()), 3);
        polytope.offsets.resize(static_cast<Eigen::Index>(normals.size()));
        for (std::size_t f = 0; f < normals.size(); ++f) {
          polytope.normals.row(static_cast<Eigen::Index>(f)) = vector(normals[f]).transpose();
          polytope.offsets(static_cast<Eigen::Index>(f)) = offsets[f];
        }
      }
      problems.push_back(std::move(stored));
    } catch (const std::exception& error) {
      throw std::runtime_error(path + ": line " + std::to_string(number) + ": " + error.what());
    }
  }
  if (problems.empty()) throw std::runtime_error(path + ": holds no problem");
  return problems;
}

}  // namespace swarm
