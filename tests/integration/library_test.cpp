// The installed libraries, as a project of others finds and links them: the example outside the tree.
#include "tests/support/harness.h"

namespace swarm::test {
namespace {

namespace fs = std::filesystem;

TEST(Library, PlansInAProjectOfOthers) {
  if (kSanitized) GTEST_SKIP() << "libraries with sanitizers want a program with sanitizers";
  if (std::string_view(SWARM_EMULATOR) != "") GTEST_SKIP() << "the libraries are for another machine";
  const TemporaryDirectory directory;
  const std::string prefix = directory / "prefix", source = directory / "source", build = directory / "build";
  const auto cmake = [](std::vector<std::string> words) {
    words.insert(words.begin(), {"/usr/bin/env", "cmake"});
    const Finished result = run_program(words, 300.0);
    EXPECT_EQ(result.exit_code, 0) << result.out << result.err;
  };
  cmake({"--install", SWARM_BIN_DIR "/..", "--prefix", prefix, "--component", "library"});
  fs::copy(SWARM_SOURCE_DIR "/tools/deploy/examples/library", source);
  cmake({"-G", "Ninja", "-S", source, "-B", build, "-DCMAKE_PREFIX_PATH=" + prefix,
         "-DCMAKE_CXX_FLAGS=-Wall -Wextra -Werror"});
  cmake({"--build", build});
  for (const auto& file : fs::recursive_directory_iterator(prefix)) {
    if (file.path().extension() != ".cmake") continue;
    const std::string text = read_text(file.path());
    EXPECT_EQ(text.find(SWARM_SOURCE_DIR), text.npos) << file.path() << ": leads back into this tree";
    EXPECT_EQ(text.find("-Werror"), text.npos) << file.path() << ": our warnings are not theirs";
  }

  const Finished planned = run_program({build + "/plan_once"});
  EXPECT_EQ(planned.exit_code, 0) << planned.err;
  std::istringstream lines(planned.out);
  std::string outcome;
  std::getline(lines, outcome);
  EXPECT_EQ(outcome, "outcome: smooth");
  double t = 0.0, apart_m = 0.0;
  Eigen::Vector3d at = Eigen::Vector3d::Zero();
  int count = 0;
  for (; lines >> t >> at.x() >> at.y() >> at.z() >> apart_m; ++count) EXPECT_GT(apart_m, 0.2) << t;
  EXPECT_GT(count, 15);
  EXPECT_GT(at.x(), 2.5) << "it is past the person";
}

}  // namespace
}  // namespace swarm::test
