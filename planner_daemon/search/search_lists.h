// The open and the closed list of the search.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace swarm {

// A node that waits, by its priority: the smallest first, among equals the oldest.
struct OpenEntry {
  double priority;
  std::int32_t node;

  bool operator<(const OpenEntry& other) const {
    return priority < other.priority || (priority == other.priority && node < other.node);
  }
};

class OpenList {
 public:
  void reserve(std::size_t entries) { heap_.reserve(entries); }
  void clear() { heap_.clear(); }
  bool empty() const { return heap_.empty(); }
  void push(const OpenEntry& entry) {
    heap_.push_back(entry);
    std::push_heap(heap_.begin(), heap_.end(), kLater);
  }
  std::int32_t pop() {
    std::pop_heap(heap_.begin(), heap_.end(), kLater);
    const std::int32_t node = heap_.back().node;
    heap_.pop_back();
    return node;
  }

 private:
  static constexpr auto kLater = [](const OpenEntry& a, const OpenEntry& b) { return b < a; };
  std::vector<OpenEntry> heap_;
};

// Lengthens a hash chain by one value (splitmix64's finaliser).
inline std::uint64_t mix(std::uint64_t hash, std::int64_t value) {
  hash ^= static_cast<std::uint64_t>(value) + 0x9e3779b97f4a7c15ULL + (hash << 6) + (hash >> 2);
  hash = (hash ^ (hash >> 30)) * 0xbf58476d1ce4e5b9ULL;
  hash = (hash ^ (hash >> 27)) * 0x94d049bb133111ebULL;
  return hash ^ (hash >> 31);
}

// A set of hashed keys with open addressing.
class ClosedList {
 public:
  // At most half as many keys are inserted between two calls of clear().
  explicit ClosedList(std::size_t least_slots) {
    std::size_t slots = 1024;
    while (slots < least_slots) slots *= 2;
    slots_.resize(slots);
  }
  void clear() { std::fill(slots_.begin(), slots_.end(), 0); }
  // False when it is there already.
  bool insert(std::uint64_t key) {
    key |= 1;  // 0 marks a free slot
    std::size_t slot = (key >> 1) & (slots_.size() - 1);
    while (slots_[slot] != 0) {
      if (slots_[slot] == key) return false;
      slot = (slot + 1) & (slots_.size() - 1);
    }
    slots_[slot] = key;
    return true;
  }

 private:
  std::vector<std::uint64_t> slots_;
};

}  // namespace swarm
