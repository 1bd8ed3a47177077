// Runs a fuzz target without libFuzzer: over all files of its corpus, and over mutations of them, always the same ones.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <vector>

#include "tests/fuzz/fuzz_input.h"

namespace swarm::fuzz {
namespace {

constexpr int kMutants = 300;
constexpr auto kLongest = std::chrono::seconds(2);  // of mutations; the files themselves are all run

Bytes read(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// A few random changes: bits, bytes, copies from elsewhere, cuts.
void mutate(std::mt19937& random, Bytes* bytes) {
  const auto below = [&random](std::size_t bound) { return static_cast<std::size_t>(random()) % bound; };
  for (std::size_t changes = 1 + below(4); changes > 0; --changes) {
    if (bytes->empty()) bytes->push_back(0);
    const std::size_t at = below(bytes->size());
    const auto place = bytes->begin() + static_cast<std::ptrdiff_t>(at);
    switch (below(5)) {
      case 0:
        *place = static_cast<std::uint8_t>(*place ^ 1u << below(8));
        break;
      case 1:
        *place = static_cast<std::uint8_t>(random());
        break;
      case 2:
        bytes->insert(place, static_cast<std::uint8_t>(random()));
        break;
      case 3: {
        const Bytes copy(place,
                         place + static_cast<std::ptrdiff_t>(below(std::min<std::size_t>(bytes->size() - at, 64))));
        bytes->insert(bytes->begin() + static_cast<std::ptrdiff_t>(below(bytes->size())), copy.begin(), copy.end());
        break;
      }
      default:
        bytes->erase(place, place + static_cast<std::ptrdiff_t>(below(bytes->size() - at)));
    }
  }
}

int run(const std::filesystem::path& directory) {
  std::vector<std::filesystem::path> files(std::filesystem::directory_iterator(directory), {});
  std::ranges::sort(files);
  if (files.empty()) throw std::runtime_error(directory.string() + ": no files");
  std::vector<Bytes> corpus;
  for (const auto& file : files) {
    std::fprintf(stderr, "%s\n", file.c_str());  // the last one is at fault
    corpus.push_back(read(file));
    try_input({corpus.back().data(), corpus.back().size()});
  }
  std::mt19937 random(1);
  const auto begun = std::chrono::steady_clock::now();
  int mutants = 0;
  for (; mutants < kMutants && std::chrono::steady_clock::now() < begun + kLongest; ++mutants) {
    Bytes bytes = corpus[random() % corpus.size()];
    mutate(random, &bytes);
    // The same number is the same mutation again.
    std::fprintf(stderr, "mutation %d\n", mutants);
    try_input({bytes.data(), bytes.size()});
  }
  std::printf("%zu files and %d mutations\n", corpus.size(), mutants);
  return 0;
}

}  // namespace
}  // namespace swarm::fuzz

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "Usage: %s CORPUS\n", argv[0]);
    return 2;
  }
  try {
    return swarm::fuzz::run(argv[1]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", argv[0], error.what());
    return 1;
  }
}
