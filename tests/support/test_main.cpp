// main() of every test program: that of GoogleTest, with two differences.
// - If a busy machine may explain every failure (excuse.h), one line for each failed test says so
// at
//   the end. tests/support/judge.py reads these lines.
// - If every test was skipped, the exit code is kSkipped. CMake's own way, a line of the output,
//   also hides what fails after the skip: the end of a suite, or a leak.
#include <gtest/gtest.h>

#include <atomic>
#include <cstdio>
#include <set>
#include <string>

#include "tests/support/excuse.h"

namespace palpate::test {
namespace {

constexpr int kSkipped = 77;  // SKIP_RETURN_CODE in tests/CMakeLists.txt

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

bool AllWereSkipped() {
  const testing::UnitTest& program = *testing::UnitTest::GetInstance();
  return program.skipped_test_count() > 0 &&
         program.skipped_test_count() == program.test_to_run_count();
}

}  // namespace
}  // namespace palpate::test

int main(int count, char** arguments) {
  testing::InitGoogleTest(&count, arguments);
  testing::UnitTest::GetInstance()->listeners().Append(new palpate::test::Excuses);
  const int code = RUN_ALL_TESTS();
  return code == 0 && palpate::test::AllWereSkipped() ? palpate::test::kSkipped : code;
}
