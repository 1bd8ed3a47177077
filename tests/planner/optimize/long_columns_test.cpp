#include "planner_daemon/optimize/long_columns.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>

namespace swarm {
namespace {

TEST(LongColumns, AreMultipliedAndTakenAway) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> number(-2.0, 2.0);
  const auto draw = [&](Eigen::Index rows, Eigen::Index columns) -> Eigen::MatrixXd {
    return Eigen::MatrixXd::NullaryExpr(rows, columns, [&](Eigen::Index, Eigen::Index) { return number(random); });
  };
  for (const Eigen::Index rows : {4, 12, 16, 84, 100}) {
    for (Eigen::Index count = 0; count <= 11; ++count) {
      SCOPED_TRACE(testing::Message() << rows << " x " << count);
      const Eigen::MatrixXd columns = draw(rows, count);
      const LongColumns long_columns{columns.data(), static_cast<std::size_t>(rows), static_cast<std::size_t>(count)};
      const Eigen::VectorXd vector = draw(rows, 1);
      Eigen::VectorXd products = Eigen::VectorXd::Constant(count + 1, 5.0);
      inner_products(long_columns, vector.data(), products.data());
      for (Eigen::Index k = 0; k < count; ++k) {
        double sum = 0.0;
        for (Eigen::Index i = 0; i < rows; ++i) sum += columns(i, k) * vector(i);
        EXPECT_NEAR(products(k), sum, 1e-12);
      }
      EXPECT_EQ(products(count), 5.0);

      Eigen::VectorXd rest = vector;
      take_away(long_columns, products.data(), rest.data());
      for (Eigen::Index i = 0; i < rows; ++i) {
        double left = vector(i);
        for (Eigen::Index k = 0; k < count; ++k) left -= products(k) * columns(i, k);
        EXPECT_EQ(rest(i), left);
      }
    }
  }
}

}  // namespace
}  // namespace swarm
