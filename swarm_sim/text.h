// Numbers as text: the shortest that reads back as the same double, whatever the locale.
#pragma once

#include <Eigen/Core>
#include <string>

namespace swarm {

std::string text_of(double value);                                     // 1.5
std::string text_of(const Eigen::Ref<const Eigen::VectorXd>& values);  // [1,2.5,0]
void append_fixed(double value, int decimals, std::string* text);      // always `decimals` digits after the point

}  // namespace swarm
