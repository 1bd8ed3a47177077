#include "planner_daemon/guidance/wavefront.h"

#include <algorithm>
#include <bit>

namespace swarm {

void Wavefront::lay_out(const Eigen::Vector3i& size, int cell) {
  size_ = size;
  cell_ = cell;
  words_ = (size.z() + 63) / 64;
  cells_ = (size.array() + cell - 1) / cell;
  const std::size_t words = word_of(size.x(), size.y()) + static_cast<std::size_t>(words_);
  open_.assign(words, 0);
  new_.assign(words, 0);
  costs_.assign(static_cast<std::size_t>(Eigen::Index{cells_.x()} * cells_.y() * cells_.z()), kUnreached);
  cell_columns_.resize(static_cast<std::size_t>((size.x() + 2) * (size.y() + 2)));
  auto* cell_column = cell_columns_.data();
  for (int x = -1; x <= size.x(); ++x) {
    for (int y = -1; y <= size.y(); ++y)
      *cell_column++ = static_cast<std::uint32_t>((x / cell * cells_.y() + y / cell) * cells_.z());
  }
  cell_at_.resize(static_cast<std::size_t>(64 * words_));
  for (std::size_t z = 0; z < cell_at_.size(); ++z)
    cell_at_[z] = static_cast<std::uint16_t>(z / static_cast<std::size_t>(cell));
  // Whose turn comes when a bucket is full depends on the front: all get the same. As a rule no front is longer than
  // that.
  std::size_t room = static_cast<std::size_t>(8 * (size.x() + size.y()) * words_);
  for (const auto& entries : ring_) room = std::max(room, entries.capacity());
  for (auto& entries : ring_) {
    entries.clear();
    entries.reserve(room);
  }
  seeds_.clear();
  started_ = false;
  cost_ = 0;
}

void Wavefront::seed(int x, int y, int w, std::uint64_t bits, int cost) {
  const auto word = static_cast<std::uint32_t>(word_of(x, y) + static_cast<std::size_t>(w));
  if ((bits & open_[word]) != 0) seeds_.push_back({cost, {word, bits}});
}

void Wavefront::seed_column(int x, int y, std::span<const int> costs) {
  const std::uint64_t* const column = open(x, y);
  for (int w = 0; w < words_; ++w) {
    for (std::uint64_t left = column[w]; left != 0;) {  // those with one cost at once
      const auto cost_of = [&](std::uint64_t bits) {
        return costs[static_cast<std::size_t>(64 * w + std::countr_zero(bits))];
      };
      const int cost = cost_of(left);
      std::uint64_t alike = 0;
      for (; left != 0 && cost_of(left) == cost; left &= left - 1) alike |= left & -left;
      if (cost < kUnreached) seed(x, y, w, alike, cost);
    }
  }
}

double Wavefront::seed_goal(const Eigen::Vector3i& goal, double beside) {
  const auto is_open = [&](const Eigen::Vector3i& voxel) {
    const bool is_inside = (voxel.array() >= 0).all() && (voxel.array() < size_.array()).all();
    return is_inside && (open(voxel.x(), voxel.y())[voxel.z() / 64] >> voxel.z() % 64 & 1) != 0;
  };
  return for_each_nearest(goal, beside, is_open, [&](const Eigen::Vector3i& voxel) {
    seed(voxel.x(), voxel.y(), voxel.z() / 64, std::uint64_t{1} << voxel.z() % 64, straight_cost(voxel - goal));
  });
}

bool Wavefront::advance(std::int64_t max_words) {
  if (!started_) {
    std::ranges::sort(seeds_, [](const Seed& a, const Seed& b) {
      return a.cost != b.cost ? a.cost > b.cost : a.voxels.word > b.voxels.word;
    });
    started_ = true;
  }
  int empty = 0;  // buckets one after the other
  while (max_words > 0) {
    if (empty == static_cast<int>(kRing)) {
      if (seeds_.empty()) return true;
      cost_ = std::max(cost_, seeds_.back().cost);
      empty = 0;
    }
    if (cost_ >= kUnreached) return true;
    auto& entries = ring_[static_cast<std::size_t>(cost_) % kRing];
    for (; !seeds_.empty() && seeds_.back().cost <= cost_; seeds_.pop_back()) reach(seeds_.back().voxels);
    for (const Voxels& voxels : entries) reach(voxels);
    empty = entries.empty() && front_.empty() ? empty + 1 : 0;
    entries.clear();
    max_words -= static_cast<std::int64_t>(front_.size());
    for (const std::uint32_t word : front_) {
      const std::uint64_t bits = new_[word];
      new_[word] = 0;
      keep_cost(word, bits);
      spread(word, bits);
    }
    front_.clear();
    ++cost_;
  }
  return false;
}

void Wavefront::reach(const Voxels& voxels) {
  const std::uint64_t bits = voxels.bits & open_[voxels.word];
  if (bits == 0) return;
  open_[voxels.word] &= ~bits;
  if (new_[voxels.word] == 0) front_.push_back(voxels.word);
  new_[voxels.word] |= bits;
}

void Wavefront::keep_cost(std::uint32_t word, std::uint64_t bits) {
  const auto words = static_cast<std::uint32_t>(words_);
  const std::uint32_t column = words == 1 ? word : word / words;  // a division less
  const std::size_t base = std::size_t{word - column * words} * 64;
  Cost* const costs = costs_.data() + cell_columns_[column];
  while (bits != 0) {  // a run of ones at a time
    const int first = std::countr_zero(bits), last = first + std::countr_one(bits >> first);
    const auto low = cell_at_[base + static_cast<std::size_t>(first)];
    const auto high = cell_at_[base + static_cast<std::size_t>(last) - 1];
    for (auto z = low; z <= high; ++z) costs[z] = std::min(costs[z], static_cast<Cost>(cost_));
    bits = last == 64 ? 0 : bits >> last << last;
  }
}

void Wavefront::spread(std::uint32_t word, std::uint64_t bits) {
  const auto column = static_cast<std::uint32_t>(words_), row = static_cast<std::uint32_t>(size_.y() + 2) * column;
  const std::uint64_t beside = bits << 1 | bits >> 1, all = bits | beside;
  const int straight = cost_ + kStraight, diagonal = cost_ + kDiagonal;
  const auto to_all = [&](std::uint32_t at, std::uint64_t some) {
    push(at - column, some, straight);
    push(at + column, some, straight);
    push(at - row, some, straight);
    push(at + row, some, straight);
    push(at - row - column, some, diagonal);
    push(at - row + column, some, diagonal);
    push(at + row - column, some, diagonal);
    push(at + row + column, some, diagonal);
  };
  push(word, beside, straight);
  to_all(word, all);
  if (words_ == 1) return;
  const std::uint32_t w = word % column;
  if ((bits >> 63) != 0 && w + 1 < column) push(word + 1, 1, straight), to_all(word + 1, 1);
  constexpr std::uint64_t kTop = std::uint64_t{1} << 63;
  if ((bits & 1) != 0 && w > 0) push(word - 1, kTop, straight), to_all(word - 1, kTop);
}

}  // namespace swarm
