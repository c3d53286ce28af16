// main() of every test program: that of GoogleTest, with two differences.
// - If a busy machine may explain every failure (excuse.h), one line for each failed test says so
//   at the end. tests/support/judge.py reads these lines.
// - A program that ran one test, skipped it and failed ends by a signal. CMake takes every other
// test
//   that it found in a program and that says "[  SKIPPED ]" for skipped, even if its suite failed
//   to begin or to end.
#include <gtest/gtest.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <set>
#include <string>

#include "tests/support/excuse.h"

namespace palpate::test {
namespace {

class Excuses : public testing::EmptyTestEventListener {
  void OnTestStart(const testing::TestInfo& test) override { test_ = &test; }
  void OnTestEnd(const testing::TestInfo&) override { test_ = nullptr; }
  // Called under GoogleTest's own lock: nothing here may ask it for the current test.
  void OnTestPartResult(const testing::TestPartResult& part) override {
    if (!part.failed()) return;
    const testing::TestInfo* test = test_;
    // Outside of a test, for example in the set-up of a suite, nothing is excused.
    if (test == nullptr || std::string(part.message()).find(kBusyMachine) == std::string::npos) {
      all_excusable_ = false;
    } else {
      failed_.insert(std::string(test->test_suite_name()) + "." + test->name());
    }
  }
  // Not before: a program that ends halfway has no excuse.
  void OnTestProgramEnd(const testing::UnitTest&) override {
    if (!all_excusable_) return;
    for (const std::string& name : failed_) std::printf("***Excusable %s\n", name.c_str());
    std::fflush(stdout);
  }

  std::atomic<const testing::TestInfo*> test_ = nullptr;
  std::set<std::string> failed_;
  bool all_excusable_ = true;
};

}  // namespace
}  // namespace palpate::test

int main(int count, char** arguments) {
  testing::InitGoogleTest(&count, arguments);
  testing::UnitTest::GetInstance()->listeners().Append(new palpate::test::Excuses);
  const int code = RUN_ALL_TESTS();
  const testing::UnitTest& all = *testing::UnitTest::GetInstance();
  if (code != 0 && all.test_to_run_count() == 1 && all.skipped_test_count() == 1) std::abort();
  return code;
}
