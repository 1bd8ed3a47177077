// Asio's own functions, compiled once instead of wherever it is included.
#include <boost/asio/impl/src.hpp>
