#include "tests/support/process.h"

#include <gtest/gtest-spi.h>
#include <gtest/gtest.h>

namespace palpate::test {
namespace {

// With what messages a program that does this makes a test fail that sends it the signal.
std::string FailuresOf(const std::string& script, bool awaited, int signal = 0) {
  testing::TestPartResultArray failures;
  {
    const testing::ScopedFakeTestPartResultReporter reporter(
        testing::ScopedFakeTestPartResultReporter::INTERCEPT_ONLY_CURRENT_THREAD, &failures);
    Process process({"/bin/sh", "-c", script}, false, std::chrono::seconds(20),
                    std::chrono::milliseconds(300));
    EXPECT_TRUE(process.WaitFor("begun"));
    if (signal != 0) process.Signal(signal);
    if (awaited) {
      process.Wait();
    } else if (signal == 0) {
      // It goes by itself before anybody asks.
      siginfo_t info{};
      waitid(P_PID, static_cast<id_t>(process.pid()), &info, WEXITED | WNOWAIT);
    }
  }
  std::string messages;
  for (int n = 0; n < failures.size(); ++n) messages += failures.GetTestPartResult(n).message();
  return messages;
}

bool Says(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(Process, ACrashFailsTheTestWithTheLastWords) {
  for (const bool awaited : {true, false}) {
    for (const std::string end : {"kill -SEGV $$", "kill -ABRT $$", "kill -KILL $$"}) {
      const std::string failures = FailuresOf("echo begun; echo last words >&2; " + end, awaited);
      EXPECT_TRUE(Says(failures, "a program crashed")) << failures;
      EXPECT_TRUE(Says(failures, "last words")) << failures;
    }
    const std::string found = FailuresOf("echo begun; echo x.cpp:1: runtime error: y >&2", awaited);
    EXPECT_TRUE(Says(found, "a sanitizer found something")) << found;
  }
}

TEST(Process, WhoDoesNotEndFailsTheTest) {
  for (const bool awaited : {true, false}) {
    const std::string failures =
        FailuresOf("trap '' TERM; echo begun; while :; do sleep 0.1; done", awaited, SIGTERM);
    EXPECT_TRUE(Says(failures, "was told to end, and does not")) << failures;
  }
  testing::TestPartResultArray failures;
  {
    const testing::ScopedFakeTestPartResultReporter reporter(
        testing::ScopedFakeTestPartResultReporter::INTERCEPT_ONLY_CURRENT_THREAD, &failures);
    Process({"/bin/sh", "-c", "exec sleep 60"}, false, std::chrono::seconds(1)).Wait();
  }
  ASSERT_EQ(failures.size(), 1);
  EXPECT_TRUE(Says(failures.GetTestPartResult(0).message(), "longer than its patience"));
}

TEST(Process, AnyOtherEndFailsNothing) {
  for (const bool awaited : {true, false}) {
    for (const std::string end : {"exit 0", "exit 3"}) {
      EXPECT_EQ(FailuresOf("echo begun; echo oh >&2; " + end, awaited), "") << end;
    }
    for (const int signal : {SIGKILL, SIGTERM, SIGABRT}) {
      EXPECT_EQ(FailuresOf("echo begun; exec sleep 60", awaited, signal), "") << signal;
    }
  }
}

// Signals to pid -1 would go to every process of this user.
TEST(Process, AfterItsEndNoSignalIsSent) {
  Process process({"/bin/sh", "-c", "exit 3"});
  EXPECT_EQ(process.Wait().exit_code, 3);
  process.Signal(SIGCONT);
  process.EndInOrder();
  EXPECT_EQ(process.Wait().exit_code, 3);
}

}  // namespace
}  // namespace palpate::test
