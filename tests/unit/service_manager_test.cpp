// What systemd is told, over a socket as systemd has it.
#include "server/app/service_manager.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdlib>

#include "tests/support/temporary_folder.h"

namespace palpate::test {
namespace {

using std::chrono::milliseconds;

class NotifySocket : public ::testing::Test {
 protected:
  void SetUp() override {
    socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    const std::string path = folder_.path() / "notify";
    path.copy(address.sun_path, sizeof(address.sun_path) - 1);
    ASSERT_EQ(bind(socket_, reinterpret_cast<sockaddr*>(&address), sizeof(address)), 0);
    setenv("NOTIFY_SOCKET", path.c_str(), 1);
  }
  void TearDown() override {
    unsetenv("NOTIFY_SOCKET");
    close(socket_);
  }
  // Empty: nothing was said.
  std::string Next() const {
    pollfd file{socket_, POLLIN, 0};
    if (poll(&file, 1, 0) <= 0) return "";
    char text[4096];
    const ssize_t count = recv(socket_, text, sizeof(text), 0);
    return std::string(text, static_cast<std::size_t>(count));
  }

  TemporaryFolder folder_;
  int socket_ = -1;
};

TEST_F(NotifySocket, HearsOfEachStage) {
  ServiceManager manager;
  manager.Loading("builtin:bumps");
  EXPECT_EQ(Next(), "STATUS=loading builtin:bumps");
  manager.Ready();
  EXPECT_EQ(Next(), "READY=1");
  manager.Reloading();
  EXPECT_TRUE(Next().starts_with("RELOADING=1\nMONOTONIC_USEC="));
  manager.Reloaded();
  EXPECT_EQ(Next(), "READY=1");
  manager.FeedWatchdog();
  EXPECT_EQ(Next(), "WATCHDOG=1");
  manager.Stopping();
  EXPECT_EQ(Next(), "STOPPING=1");
}

// A volume's name comes from a client: it must not speak for the daemon.
TEST_F(NotifySocket, AStatusIsOneLineAndSaidOnce) {
  ServiceManager manager;
  manager.Status("/data/a\nWATCHDOG=1\n");
  EXPECT_EQ(Next(), "STATUS=/data/a WATCHDOG=1 ");
  manager.Status("/data/a\nWATCHDOG=1\n");
  EXPECT_EQ(Next(), "");
  manager.Status("other");
  EXPECT_EQ(Next(), "STATUS=other");
}

TEST(WithoutSystemd, NothingIsSaid) {
  unsetenv("NOTIFY_SOCKET");
  unsetenv("WATCHDOG_USEC");
  ServiceManager().Ready();
  EXPECT_FALSE(ServiceManager::WatchdogInterval());
}

TEST(Watchdog, IsFedOnlyWhileTheServoTicks) {
  ServoWatchdog watchdog(milliseconds(400));
  ServoWatchdog::Time now{std::chrono::hours(1)};
  EXPECT_TRUE(watchdog.IsDue(1, now));
  // Ticks, but it was fed just now.
  EXPECT_FALSE(watchdog.IsDue(50, now += milliseconds(50)));
  EXPECT_TRUE(watchdog.IsDue(100, now += milliseconds(50)));
  // Stuck: for however long.
  for (int n = 0; n < 100; ++n) EXPECT_FALSE(watchdog.IsDue(100, now += milliseconds(100)));
  // One tick is not yet a servo that runs.
  EXPECT_FALSE(watchdog.IsDue(101, now));
  EXPECT_FALSE(watchdog.IsDue(102, now += milliseconds(100)));
  EXPECT_TRUE(watchdog.IsDue(202, now += milliseconds(100)));
}

TEST(Watchdog, AServoRunsWithHalfOfItsTicks) {
  EXPECT_TRUE(ServoRan(1000, std::chrono::seconds(1)));
  EXPECT_TRUE(ServoRan(500, std::chrono::seconds(1)));
  EXPECT_FALSE(ServoRan(499, std::chrono::seconds(1)));
  EXPECT_FALSE(ServoRan(1, milliseconds(100)));
  EXPECT_FALSE(ServoRan(0, milliseconds(0)));
  // Of no time that was judged.
  EXPECT_TRUE(ServoRan(1, milliseconds(0)));
}

// How often a watchdog of 5 s is fed in 20 s by a servo that makes `ticks` of every 100.
int FeedsOf(std::uint64_t ticks) {
  ServoWatchdog watchdog(std::chrono::seconds(5));
  ServoWatchdog::Time now{std::chrono::hours(1)};
  int feeds = -1;  // the first one is for its start
  for (std::uint64_t look = 0; look <= 200; ++look) {
    feeds += watchdog.IsDue(1 + look * ticks, now);
    now += ServoWatchdog::kLookPeriod;
  }
  return feeds;
}

TEST(Watchdog, AServoThatLimpsStarvesIt) {
  EXPECT_EQ(FeedsOf(100), 15);  // every 1.3 s: looks are 0.1 s apart
  EXPECT_EQ(FeedsOf(60), 15);
  EXPECT_EQ(FeedsOf(40), 0);
  EXPECT_EQ(FeedsOf(1), 0);
}

// Four quarters at most are judged within an interval, so that one of them suffices.
TEST(Watchdog, AServoThatRecoversIsFedInTime) {
  ServoWatchdog watchdog(std::chrono::seconds(5));
  ServoWatchdog::Time now{std::chrono::hours(1)};
  std::uint64_t ticks = 1;
  ASSERT_TRUE(watchdog.IsDue(ticks, now));
  const ServoWatchdog::Time fed = now;
  for (int look = 0; look < 20; ++look) {
    EXPECT_FALSE(watchdog.IsDue(ticks, now += ServoWatchdog::kLookPeriod));
  }
  while (!watchdog.IsDue(ticks += 100, now += ServoWatchdog::kLookPeriod)) {
  }
  EXPECT_LE(now - fed, std::chrono::seconds(4));
}

// Neither the servo nor who looks at it ran: it is judged by the rest.
TEST(Watchdog, AMachineThatStoodStillIsForgiven) {
  ServoWatchdog watchdog(std::chrono::seconds(5));
  ServoWatchdog::Time now{std::chrono::hours(1)};
  std::uint64_t ticks = 1;
  ASSERT_TRUE(watchdog.IsDue(ticks, now));
  for (int n = 0; n < 10; ++n) {
    for (int look = 0; look < 10; ++look) {
      EXPECT_FALSE(watchdog.IsDue(ticks += 60, now += ServoWatchdog::kLookPeriod));
    }
    EXPECT_TRUE(watchdog.IsDue(ticks += 1, now += std::chrono::seconds(3)));
  }
  // It hardly does anything else.
  for (int n = 0; n < 10; ++n) {
    EXPECT_TRUE(watchdog.IsDue(ticks += 1, now += std::chrono::seconds(3)));
  }
  // But a servo that does not tick is stuck, whatever the machine does.
  for (int n = 0; n < 10; ++n) {
    EXPECT_FALSE(watchdog.IsDue(ticks, now += std::chrono::seconds(3)));
    for (int look = 0; look < 30; ++look) {
      EXPECT_FALSE(watchdog.IsDue(ticks, now += ServoWatchdog::kLookPeriod));
    }
  }
}

TEST(Watchdog, IsNotFedBeforeTheFirstTickNorWhereThereIsNone) {
  ServoWatchdog::Time now{std::chrono::hours(1)};
  EXPECT_FALSE(ServoWatchdog(milliseconds(400)).IsDue(0, now));
  EXPECT_FALSE(ServoWatchdog(std::nullopt).IsDue(1000, now));
}

}  // namespace
}  // namespace palpate::test
