// The heap of palpated. This program has it too.
#include "server/realtime/process_heap.h"

#include <gtest/gtest.h>
#include <jemalloc/jemalloc.h>
#include <sys/mman.h>

#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "server/realtime/thread_setup.h"
#include "tests/support/patience.h"

namespace palpate {
namespace {

constexpr std::size_t kBlockBytes = 2048, kBlocks = 32768;  // 64 MiB of blocks like a brick's
constexpr std::int64_t kMostKib = 60 * 1024;

std::int64_t StatusKib(const std::string& key) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with(key + ":")) return std::stoll(line.substr(key.size() + 1));
  }
  return -1;
}

// Blocks below one that stays: the heap cannot shrink at its end.
class ProcessHeap : public ::testing::Test {
 protected:
  using Block = std::unique_ptr<std::string>;
  static Block Make() { return std::make_unique<std::string>(kBlockBytes, 'x'); }

  void SetUp() override {
    LockProcessMemory(warnings_);
    Fill();
    kept_ = Make();
    full_kib_ = StatusKib("VmRSS");
  }
  void TearDown() override {
    munlockall();
    if (!warnings_.empty()) GTEST_SKIP() << "not locked: " << warnings_.at(0);
  }
  void Fill() {
    for (std::size_t n = 0; n < kBlocks; ++n) blocks_.push_back(Make());
  }

  std::vector<std::string> warnings_;
  std::vector<Block> blocks_;
  Block kept_;
  std::int64_t full_kib_ = 0;
};

TEST_F(ProcessHeap, FreedMemoryGoesBackAlsoWhereMemoryIsLocked) {
  // jemalloc's own thread may be giving back what was freed, and be a little late.
  bool has_thread = false;
  ASSERT_EQ(mallctl("background_thread", nullptr, nullptr, &has_thread, sizeof has_thread), 0);
  const std::int64_t locked_kib = StatusKib("VmLck");
  blocks_.clear();
  ReturnFreedMemory();
  EXPECT_LT(StatusKib("VmRSS"), full_kib_ - kMostKib);
  // All stays locked, what is made later too.
  EXPECT_EQ(warnings_.empty(), locked_kib > kMostKib);
  Fill();
  if (warnings_.empty()) {
    EXPECT_GE(StatusKib("VmLck"), StatusKib("RssAnon"));
  }
  has_thread = true;
  ASSERT_EQ(mallctl("background_thread", nullptr, nullptr, &has_thread, sizeof has_thread), 0);
}

TEST_F(ProcessHeap, FreedMemoryGoesBackByItself) {
  blocks_.clear();
  EXPECT_TRUE(test::Eventually([&] { return StatusKib("VmRSS") < full_kib_ - kMostKib; }));
}

}  // namespace
}  // namespace palpate
