// What a daemon tells systemd, where that has started it: that it is ready, and again and again that its event loop
// runs. A daemon that hangs is then started again (WatchdogSec in its unit).
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <string>
#include <string_view>

#include "lcmtypes/bus/time.h"

namespace swarm {

class ServiceManager {
 public:
  // From the environment: NOTIFY_SOCKET (a path, or @ and an abstract name), WATCHDOG_USEC, WATCHDOG_PID (see
  // sd_notify(3), sd_watchdog_enabled(3)). Without the first nothing is sent, without a sensible second one only that
  // the daemon is ready.
  explicit ServiceManager(boost::asio::io_context& io);
  ~ServiceManager();
  ServiceManager(const ServiceManager&) = delete;
  ServiceManager& operator=(const ServiceManager&) = delete;

  // Ready; from here on the loop is watched: it must come by three times in WATCHDOG_USEC.
  void begin();

 private:
  void tell(std::string_view what) const;
  void come_by();

  std::string socket_path_;
  Duration period_{};  // 0: nobody watches
  int socket_ = -1;
  boost::asio::steady_timer timer_;
};

}  // namespace swarm
