// Threads that do many small things at the same time.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace swarm {

class WorkerThreads {
 public:
  using Work = std::function<void(std::size_t)>;

  // So many at a time, the calling thread among them.
  explicit WorkerThreads(int threads);
  ~WorkerThreads();
  WorkerThreads(const WorkerThreads&) = delete;
  WorkerThreads& operator=(const WorkerThreads&) = delete;

  // Calls work(i) once for each i in [0, n), in any order, several at a time, and returns when all have returned.
  // Throws what the call with the lowest i that threw did, after all others. One caller at a time.
  void for_each(std::size_t n, const Work& work);

 private:
  void do_next(std::unique_lock<std::mutex>* lock);  // which is held, but not while it works

  std::mutex mutex_;
  std::condition_variable is_more_, is_done_;
  const Work* work_ = nullptr;
  std::size_t next_ = 0, end_ = 0, running_ = 0;
  std::exception_ptr failure_;
  std::size_t failed_ = 0;  // whose it is
  bool ends_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace swarm
