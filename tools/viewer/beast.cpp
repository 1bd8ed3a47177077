// Beast's own functions, compiled once instead of wherever it is included.
#include <boost/beast/src.hpp>
