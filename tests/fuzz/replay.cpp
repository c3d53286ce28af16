// The corpus of a fuzz target without a fuzzer: each file whole, and each beginning of
// it. A wrong result ends the program; the last line says which file it was.
#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

TEST(Corpus, IsTakenWithoutAComplaint) {
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(PALPATE_CORPUS)) {
    std::ifstream in(entry.path(), std::ios::binary);
    const std::vector<char> bytes{std::istreambuf_iterator<char>(in), {}};
    std::cout << entry.path().filename().string() << std::endl;
    for (std::size_t size = 0; size <= bytes.size(); ++size) {
      // On the heap and of this size, so that AddressSanitizer sees what is behind.
      const std::vector<std::uint8_t> part(bytes.begin(),
                                           bytes.begin() + static_cast<std::ptrdiff_t>(size));
      EXPECT_EQ(LLVMFuzzerTestOneInput(part.data(), part.size()), 0);
    }
    ++files;
  }
  EXPECT_GT(files, 0);
}
