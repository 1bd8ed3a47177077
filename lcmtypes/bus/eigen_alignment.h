// Programs that link the installed libraries hand Eigen's objects to and fro: what one has got the other may free.
#pragma once

#include <Eigen/Core>

static_assert(EIGEN_DEFAULT_ALIGN_BYTES == 16,
              "Eigen lays its objects out in another way than in the libraries: compile without -march=native, -mavx");
