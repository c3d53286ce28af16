#include "tests/support/process.h"

#include <gtest/gtest.h>

namespace palpate::test {
namespace {

// What a program that does this makes a test say.
std::string SaidOf(const std::string& script, bool awaited) {
  testing::internal::CaptureStderr();
  {
    Process process({"/bin/sh", "-c", script});
    if (awaited) {
      process.Wait();
    } else {
      EXPECT_TRUE(process.WaitFor("begun"));
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
    for (const std::string end : {"kill -SEGV $$", "kill -ABRT $$"}) {
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
    for (const std::string end : {"exit 0", "exit 3", "kill -KILL $$", "kill -TERM $$"}) {
      EXPECT_EQ(SaidOf("echo begun; echo oh >&2; " + end, awaited), "") << end;
    }
  }
}

}  // namespace
}  // namespace palpate::test
