// The corpora of all fuzz targets without a fuzzer: each file whole, and beginnings of
// it. A wrong result ends the program; the last line says which file it was.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <ostream>
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

class FuzzCorpus : public testing::TestWithParam<Target> {};

TEST_P(FuzzCorpus, IsTakenWithoutAComplaint) {
  const std::filesystem::path corpus(palpate::test::kFuzzCorpus);
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(corpus / GetParam().name)) {
    std::ifstream in(entry.path(), std::ios::binary);
    const std::vector<char> bytes{std::istreambuf_iterator<char>(in), {}};
    std::cout << entry.path().filename().string() << std::endl;
    const auto run = [&](std::size_t size) {
      // On the heap and of this size, so that AddressSanitizer sees what is behind.
      const std::vector<std::uint8_t> part(bytes.begin(),
                                           bytes.begin() + static_cast<std::ptrdiff_t>(size));
      EXPECT_EQ(GetParam().run(part.data(), part.size()), 0);
    };
    const auto beginnings = static_cast<std::size_t>(palpate::test::Scaled(kMostBeginnings));
    const std::size_t step = std::max<std::size_t>(1, bytes.size() / beginnings);
    for (std::size_t size = 0; size < bytes.size(); size += step) run(size);
    run(bytes.size());
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
