// main() of every test program: that of GoogleTest, with one difference. A program that ran one test,
// skipped it and failed ends by a signal. CMake takes every other test that it found in a program
// and that says "[  SKIPPED ]" for skipped, even if its suite failed to begin or to end.
#include <gtest/gtest.h>

#include <cstdlib>

int main(int count, char** arguments) {
  testing::InitGoogleTest(&count, arguments);
  const int code = RUN_ALL_TESTS();
  const testing::UnitTest& all = *testing::UnitTest::GetInstance();
  if (code != 0 && all.test_to_run_count() == 1 && all.skipped_test_count() == 1) std::abort();
  return code;
}
