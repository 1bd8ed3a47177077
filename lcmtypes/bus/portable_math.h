// Elementary functions from the basic operations alone, which round alike on every machine. Those of the C library may
// differ in the last bit from one processor to another, and so may flights that use them.
#pragma once

namespace swarm {

struct SinCos {
  double sin, cos;
};

// For |angle| <= 1e6 rad; absolute error below 3e-16.
SinCos sin_cos(double angle_rad);
// Of the vector (x, y), in [-pi, pi]: std::atan2(y, x), to 1e-15 rad.
double direction(double x, double y);
// Natural logarithm of a positive normal number, to 4e-16 of the greater of itself and one.
double logarithm(double value);

}  // namespace swarm
