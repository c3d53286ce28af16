// The corpora of all fuzz targets without a fuzzer: each file whole, beginnings of it, and copies
// with a few changed bytes. A wrong result ends the program; the last line says which file it was.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <ostream>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "tests/support/places.h"
#include "tests/support/scaled.h"

#define PALPATE_FUZZ_TARGET(name) extern "C" int name(const std::uint8_t* data, std::size_t size);
#include "fuzz_targets.inc"
#undef PALPATE_FUZZ_TARGET

namespace {

// All beginnings of a short file; of a long one as many.
constexpr int kMostBeginnings = 600;
constexpr int kChangedCopies = 100;

using Bytes = std::vector<std::uint8_t>;

struct Target {
  std::string name;
  int (*run)(const std::uint8_t* data, std::size_t size);
};
void PrintTo(const Target& target, std::ostream* out) { *out << target.name; }

std::vector<Target> Targets() {
  return {
#define PALPATE_FUZZ_TARGET(name) {#name, name},
#include "fuzz_targets.inc"
#undef PALPATE_FUZZ_TARGET
  };
}

class FuzzCorpus : public testing::TestWithParam<Target> {
 protected:
  // A copy on the heap, of this size, so that AddressSanitizer sees what is behind.
  static void Run(const Bytes& input) { EXPECT_EQ(GetParam().run(input.data(), input.size()), 0); }

  static void RunBeginnings(const Bytes& whole) {
    const auto beginnings = static_cast<std::size_t>(palpate::test::Scaled(kMostBeginnings));
    const std::size_t step = std::max<std::size_t>(1, whole.size() / beginnings);
    for (std::size_t size = 0; size < whole.size(); size += step) {
      Run(Bytes(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size)));
    }
  }

  // One to four bytes, half of them where a file's header is.
  static void RunChanged(const Bytes& whole) {
    if (whole.empty()) return;
    std::mt19937 random(static_cast<unsigned>(whole.size()));
    for (int copy = palpate::test::Scaled(kChangedCopies); copy > 0; --copy) {
      Bytes changed = whole;
      for (unsigned changes = 1 + random() % 4; changes > 0; --changes) {
        const std::size_t end =
            random() % 2 ? whole.size() : std::min<std::size_t>(whole.size(), 60);
        changed[random() % end] = static_cast<std::uint8_t>(random());
      }
      Run(changed);
    }
  }
};

TEST_P(FuzzCorpus, IsTakenWithoutAComplaint) {
  const std::filesystem::path corpus(palpate::test::kFuzzCorpus);
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(corpus / GetParam().name)) {
    std::ifstream in(entry.path(), std::ios::binary);
    const Bytes whole{std::istreambuf_iterator<char>(in), {}};
    std::cout << entry.path().filename().string() << std::endl;
    RunBeginnings(whole);
    RunChanged(whole);
    Run(whole);
    ++files;
  }
  EXPECT_GT(files, 0);
}

INSTANTIATE_TEST_SUITE_P(Fuzz, FuzzCorpus, testing::ValuesIn(Targets()),
                         [](const auto& tested) { return tested.param.name; });

// A folder that no target reads would be a corpus that no test replays.
TEST(FuzzCorpora, HaveATarget) {
  std::set<std::string> names, folders;
  for (const Target& target : Targets()) names.insert(target.name);
  for (const auto& entry : std::filesystem::directory_iterator(palpate::test::kFuzzCorpus)) {
    folders.insert(entry.path().filename().string());
  }
  EXPECT_EQ(names, folders);
}

}  // namespace
