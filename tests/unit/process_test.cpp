#include "tests/support/process.h"

#include <gtest/gtest.h>

namespace palpate::test {
namespace {

// What a program that does this makes a test say, where the test sends it that signal.
std::string SaidOf(const std::string& script, bool awaited, int signal = 0) {
  testing::internal::CaptureStderr();
  {
    Process process({"/bin/sh", "-c", script});
    EXPECT_TRUE(process.WaitFor("begun"));
    if (signal != 0) process.Signal(signal);
    if (awaited) {
      process.Wait();
    } else {
      // It goes by itself before anybody asks.
      siginfo_t info{};
      waitid(P_PID, static_cast<id_t>(process.pid()), &info, WEXITED | WNOWAIT);
    }
  }
  return testing::internal::GetCapturedStderr();
}

// tests/run.sh looks for the first word.
TEST(Process, ACrashIsSaidWithTheLastWords) {
  for (const bool awaited : {true, false}) {
    for (const std::string end : {"kill -SEGV $$", "kill -ABRT $$", "kill -KILL $$"}) {
      const std::string said = SaidOf("echo begun; echo last words >&2; " + end, awaited);
      EXPECT_TRUE(said.starts_with("***Exception: a program crashed")) << said;
      EXPECT_NE(said.find("last words"), std::string::npos) << said;
    }
    const std::string found = SaidOf("echo begun; echo x.cpp:1: runtime error: y >&2", awaited);
    EXPECT_TRUE(found.starts_with("***Exception")) << found;
  }
}

TEST(Process, AnyOtherEndIsNone) {
  for (const bool awaited : {true, false}) {
    for (const std::string end : {"exit 0", "exit 3"}) {
      EXPECT_EQ(SaidOf("echo begun; echo oh >&2; " + end, awaited), "") << end;
    }
    for (const int signal : {SIGKILL, SIGTERM, SIGABRT}) {
      EXPECT_EQ(SaidOf("echo begun; exec sleep 60", awaited, signal), "") << signal;
    }
  }
}

}  // namespace
}  // namespace palpate::test
