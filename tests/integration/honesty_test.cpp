// The tests themselves: which failures are excused, and what a daemon's bad end does to the test
// that started it. tests/support/judge.py reads what is looked at here.
#include <gtest/gtest-spi.h>
#include <gtest/gtest.h>

#include "tests/support/places.h"
#include "tests/support/process.h"

namespace palpate::test {
namespace {

constexpr char kExcusable[] = "\n***Excusable ";

// The exit code and output of tests of honesty_child.cpp; stand_in: what their daemon does at its
// end.
ProcessResult RunChild(const std::string& tests, const std::string& stand_in = "order") {
  setenv("PALPATE_STAND_IN", stand_in.c_str(), 1);
  return Process({test::kHonestyChild, "--gtest_filter=" + tests}).Wait();
}

bool Says(const ProcessResult& result, const std::string& text) {
  return result.output.find(text) != std::string::npos;
}

TEST(Honesty, OnlyMarkedFailuresAreExcusable) {
  for (const std::string test : {"FailsExcusably", "FailsExcusablyInAThread"}) {
    const ProcessResult result = RunChild("HonestyChild." + test);
    EXPECT_EQ(result.exit_code, 1);
    EXPECT_TRUE(Says(result, kExcusable + ("HonestyChild." + test + "\n"))) << result.output;
  }
  for (const std::string test :
       {"HonestyChild.FailsForGood", "HonestyChild.FailsExcusablyAndForGood",
        "HonestyChild.FailsExcusablyAndThrows", "HonestyChild.FailsExcusablyAndExits"}) {
    const ProcessResult result = RunChild(test);
    EXPECT_EQ(result.exit_code, 1) << test;
    EXPECT_FALSE(Says(result, kExcusable)) << result.output;
  }
}

TEST(Honesty, OneFailureForGoodLeavesNoneExcusable) {
  const ProcessResult both = RunChild("HonestyChild.FailsExcusably:HonestyChild.FailsForGood");
  EXPECT_EQ(both.exit_code, 1);
  EXPECT_FALSE(Says(both, kExcusable)) << both.output;
  const ProcessResult others = RunChild("HonestyChild.FailsExcusably:HonestyChild.Passes");
  EXPECT_EQ(others.exit_code, 1);
  EXPECT_TRUE(Says(others, kExcusable)) << others.output;
}

TEST(Honesty, WhatPassesOrSkipsNeedsNoExcuse) {
  const ProcessResult result = RunChild("HonestyChild.Passes:HonestyChild.Skips");
  EXPECT_EQ(result.exit_code, 0);
  // Not shown: CMake would take the word in it for a skip of this test.
  EXPECT_TRUE(Says(result, "[  SKIPPED ]"));
  EXPECT_FALSE(Says(result, kExcusable));
}

// GoogleTest itself skips the tests of a suite that fails to begin.
TEST(Honesty, ASkipHidesNoFailureBesideIt) {
  for (const std::string test : {"HonestyChildSuite.*", "HonestyChildSkippedSuite.*"}) {
    ProcessResult result;
    EXPECT_NONFATAL_FAILURE(result = RunChild(test), "a program crashed (signal 6)");
    EXPECT_EQ(result.exit_code, -SIGABRT) << test;
  }
}

// Of a program that is one test of ctest's, CMake takes the exit code.
TEST(Honesty, AFailureBesideASkipMayBeExcusable) {
  const ProcessResult result = RunChild("HonestyChild.FailsExcusably:HonestyChild.Skips");
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_TRUE(Says(result, kExcusable)) << result.output;
}

TEST(Honesty, ACrashIsNotExcusable) {
  ProcessResult result;
  EXPECT_NONFATAL_FAILURE(result = RunChild("HonestyChild.FailsExcusablyAndCrashes"),
                          "a program crashed (signal 6)");
  EXPECT_EQ(result.exit_code, -SIGABRT);
  EXPECT_FALSE(Says(result, kExcusable)) << result.output;
}

// A test that passes otherwise.
TEST(Honesty, ADaemonThatEndsBadlyFailsItsTest) {
  struct Case {
    std::string stand_in, line;
  };
  for (const Case& c : {Case{"abort", "a program crashed (signal 6)"},
                        Case{"hang", "a program was told to end, and does not"},
                        Case{"leak", "a sanitizer found something"},
                        Case{"fail", "a program ended with 3, not with 0"}}) {
    for (const std::string test :
         {"HonestyChildDaemon.IsLeftToItself", "HonestyChildDaemon.IsEnded",
          "HonestyChildDaemon.IsStopped", "HonestyChildDaemon.IsRestarted",
          "HonestyChildSuiteDaemon.IsShared"}) {
      // One that was awaited is the test's to judge.
      if (c.stand_in == "fail" && test.ends_with("IsEnded")) continue;
      // Its patience is two minutes.
      if (c.stand_in == "hang" && test.ends_with("IsRestarted")) continue;
      SCOPED_TRACE(c.stand_in + " " + test);
      const ProcessResult result = RunChild(test, c.stand_in);
      EXPECT_EQ(result.exit_code, 1);
      EXPECT_TRUE(Says(result, c.line)) << result.output;
      EXPECT_FALSE(Says(result, kExcusable)) << result.output;
    }
  }
}

TEST(Honesty, ADaemonThatEndsInOrderOrIsKilledFailsNothing) {
  const ProcessResult ordered = RunChild("HonestyChildDaemon.*:HonestyChildSuiteDaemon.*");
  EXPECT_EQ(ordered.exit_code, 0) << ordered.output;
  const ProcessResult killed = RunChild("HonestyChildDaemon.IsKilled", "hang");
  EXPECT_EQ(killed.exit_code, 0) << killed.output;
}

}  // namespace
}  // namespace palpate::test
