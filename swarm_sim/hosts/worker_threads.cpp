#include "swarm_sim/hosts/worker_threads.h"

#include <utility>

namespace swarm {

WorkerThreads::WorkerThreads(int threads) {
  for (int i = 1; i < threads; ++i) {
    threads_.emplace_back([this] {
      std::unique_lock lock(mutex_);
      for (;;) {
        is_more_.wait(lock, [this] { return ends_ || next_ < end_; });
        if (ends_) return;
        do_next(&lock);
      }
    });
  }
}

WorkerThreads::~WorkerThreads() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  is_more_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void WorkerThreads::for_each(std::size_t n, const Work& work) {
  std::unique_lock lock(mutex_);
  work_ = &work;
  next_ = 0;
  end_ = n;
  if (n > 1) is_more_.notify_all();
  while (next_ < end_) do_next(&lock);
  is_done_.wait(lock, [this] { return running_ == 0; });
  if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
}

void WorkerThreads::do_next(std::unique_lock<std::mutex>* lock) {
  const std::size_t i = next_++;
  ++running_;
  lock->unlock();
  std::exception_ptr failure;
  try {
    (*work_)(i);
  } catch (...) {
    failure = std::current_exception();
  }
  lock->lock();
  if (failure && (!failure_ || i < failed_)) {
    failure_ = failure;
    failed_ = i;
  }
  if (--running_ == 0 && next_ == end_) is_done_.notify_one();
}

}  // namespace swarm
