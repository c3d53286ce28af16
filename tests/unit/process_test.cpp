#include "tests/support/process.h"

#include <gtest/gtest-spi.h>
#include <gtest/gtest.h>

namespace palpate::test {
namespace {

// Whether the test that runs the script as a program fails with this; "": does not fail.
// `signal`: what the test sends it once it says that it has begun.
::testing::AssertionResult Says(const std::string& said, const std::string& script, bool awaited,
                                int signal = 0,
                                std::chrono::milliseconds end_patience = Process::kEndPatience) {
  ::testing::TestPartResultArray failures;
  {
    const ::testing::ScopedFakeTestPartResultReporter reporter(
        ::testing::ScopedFakeTestPartResultReporter::INTERCEPT_ONLY_CURRENT_THREAD, &failures);
    Process process({"/bin/sh", "-c", script}, std::chrono::seconds(120), end_patience);
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
  const bool right = said.empty() ? messages.empty() : messages.find(said) != std::string::npos;
  return (right ? ::testing::AssertionSuccess() : ::testing::AssertionFailure()) << messages;
}

TEST(Process, WhatFailsTheTest) {
  for (const bool awaited : {true, false}) {
    for (const std::string end : {"kill -SEGV $$", "kill -ABRT $$", "kill -KILL $$"}) {
      const std::string script = "echo begun; echo last words >&2; " + end;
      EXPECT_TRUE(Says("a program crashed", script, awaited)) << end;
      EXPECT_TRUE(Says("last words", script, awaited)) << end;
    }
    EXPECT_TRUE(
        Says("a sanitizer found", "echo begun; echo x.cpp:1: runtime error: y >&2", awaited));
    EXPECT_TRUE(Says("does not", "trap '' TERM; echo begun; while :; do sleep 0.1; done", awaited,
                     SIGTERM, std::chrono::milliseconds(300)));
  }
  EXPECT_NONFATAL_FAILURE(
      Process({"/bin/sh", "-c", "exec sleep 60"}, std::chrono::seconds(1)).Wait(),
      "longer than its patience");
}

TEST(Process, AnyOtherEndFailsNothing) {
  for (const bool awaited : {true, false}) {
    for (const std::string end : {"exit 0", "exit 3"}) {
      EXPECT_TRUE(Says("", "echo begun; echo oh >&2; " + end, awaited)) << end;
    }
    for (const int signal : {SIGKILL, SIGTERM, SIGABRT}) {
      EXPECT_TRUE(Says("", "echo begun; exec sleep 60", awaited, signal)) << signal;
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
