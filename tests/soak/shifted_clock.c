// Preloaded into a robot's daemons: their wall clock is ahead by what the file SHIFTED_CLOCK says [ns], at any moment.
#define _GNU_SOURCE
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

static const volatile int64_t* ahead_ns;

__attribute__((constructor)) static void open_file(void) {
  const char* path = getenv("SHIFTED_CLOCK");
  const int file = path != NULL ? open(path, O_RDONLY | O_CLOEXEC) : -1;
  void* memory = file >= 0 ? mmap(NULL, sizeof *ahead_ns, PROT_READ, MAP_SHARED, file, 0) : MAP_FAILED;
  if (memory == MAP_FAILED) _exit(2);
  ahead_ns = memory;
  close(file);
}

int clock_gettime(clockid_t clock, struct timespec* time) {
  const int64_t second = 1000000000;
  const int result = (int)syscall(SYS_clock_gettime, clock, time);
  if (result != 0 || clock != CLOCK_REALTIME || ahead_ns == NULL) return result;
  const int64_t ns = time->tv_sec * second + time->tv_nsec + *ahead_ns;
  time->tv_sec = ns / second;
  time->tv_nsec = ns % second;
  return 0;
}
