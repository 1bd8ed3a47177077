// Every malloc of a test program is counted: what is to take no memory from the heap can be seen to take none. Include
// it in one file of a program.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdlib>

// The sanitizers bring their own allocator.
#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__)
#define SWARM_COUNTS_ALLOCATIONS

namespace swarm::test {
inline std::atomic<bool> is_counting = false;
inline std::atomic<int> num_allocations = 0;
inline std::atomic<std::size_t> allocated_bytes = 0;

inline void count_allocation(std::size_t size) {
  if (!is_counting) return;
  ++num_allocations;
  allocated_bytes += size;
}

// How often `call` took memory; how much is in `allocated_bytes`.
template <class Call>
int allocations_of(const Call& call) {
  num_allocations = 0;
  is_counting = true;
  call();
  is_counting = false;
  return num_allocations;
}

}  // namespace swarm::test

extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);

void* malloc(std::size_t size) {
  swarm::test::count_allocation(size);
  return __libc_malloc(size);
}
void* calloc(std::size_t number, std::size_t size) {
  swarm::test::count_allocation(number * size);
  return __libc_calloc(number, size);
}
void* realloc(void* old, std::size_t size) {
  swarm::test::count_allocation(size);
  return __libc_realloc(old, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  swarm::test::count_allocation(size);
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** out, std::size_t alignment, std::size_t size) {
  swarm::test::count_allocation(size);
  *out = __libc_memalign(alignment, size);
  return *out == nullptr ? 12 : 0;
}
}

#endif
