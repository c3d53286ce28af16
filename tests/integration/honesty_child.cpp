// Tests that fail, each in its own way; honesty_test.cpp runs them one by one. Their palpated
// is tests/support/stand_in.sh.
#include <gtest/gtest.h>

#include <cstdlib>
#include <thread>

#include "tests/support/daemon.h"
#include "tests/support/excuse.h"
#include "tests/support/places.h"
#include "tests/support/restarted_daemon.h"

namespace palpate::test {
namespace {

constexpr std::chrono::milliseconds kEndPatience{700};

void FailExcusably() { EXPECT_LT(2, 1) << kBusyMachine; }

TEST(HonestyChild, Passes) {}
TEST(HonestyChild, FailsExcusably) { FailExcusably(); }
TEST(HonestyChild, FailsExcusablyInAThread) { std::thread(FailExcusably).join(); }
TEST(HonestyChild, FailsExcusablyAndForGood) {
  FailExcusably();
  EXPECT_EQ(2, 1);
}
TEST(HonestyChild, FailsForGood) { EXPECT_EQ(2, 1); }
TEST(HonestyChild, FailsExcusablyAndThrows) {
  FailExcusably();
  throw std::runtime_error("thrown");
}
TEST(HonestyChild, FailsExcusablyAndCrashes) {
  FailExcusably();
  std::abort();
}
TEST(HonestyChild, FailsExcusablyAndExits) {
  FailExcusably();
  std::exit(1);
}
TEST(HonestyChild, Skips) { GTEST_SKIP(); }

class HonestyChildSuite : public testing::Test {
 protected:
  static void SetUpTestSuite() { FailExcusably(); }
};
TEST_F(HonestyChildSuite, FailsToBegin) { FailExcusably(); }

class HonestyChildSkippedSuite : public testing::Test {
 protected:
  static void TearDownTestSuite() { EXPECT_EQ(2, 1); }
};
TEST_F(HonestyChildSkippedSuite, FailsToEnd) { GTEST_SKIP(); }

TEST(HonestyChildDaemon, IsLeftToItself) {
  const Daemon daemon(test::kStandIn, {}, {}, Daemon::kPatience, kEndPatience);
}
TEST(HonestyChildDaemon, IsEnded) {
  Daemon daemon(test::kStandIn, {}, {}, Daemon::kPatience, kEndPatience);
  daemon.End();
}
TEST(HonestyChildDaemon, IsKilled) {
  Daemon daemon(test::kStandIn, {}, {}, Daemon::kPatience, kEndPatience);
  EXPECT_EQ(daemon.End(SIGKILL).exit_code, -SIGKILL);
}
TEST(HonestyChildDaemon, IsStopped) {
  Daemon daemon(test::kStandIn, {}, {}, Daemon::kPatience, kEndPatience);
  daemon.process().Signal(SIGSTOP);
}
TEST(HonestyChildDaemon, IsRestarted) {
  RestartedDaemon daemon({}, test::kStandIn);
  daemon.Start();
}

class HonestyChildSuiteDaemon : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    daemon_ = std::make_unique<Daemon>(test::kStandIn, std::vector<std::string>{},
                                       std::vector<std::string>{}, Daemon::kPatience, kEndPatience);
  }
  static void TearDownTestSuite() { daemon_.reset(); }
  static inline std::unique_ptr<Daemon> daemon_;
};
TEST_F(HonestyChildSuiteDaemon, IsShared) {}

}  // namespace
}  // namespace palpate::test
