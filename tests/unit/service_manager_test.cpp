// What systemd is told, over a socket as systemd has it; and small stacks of threads.
#include "server/app/service_manager.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <pthread.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdlib>
#include <thread>

#include "server/app/thread_stacks.h"
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
  manager.Status("loading builtin:bumps");
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

// A servo and its watchdog, on a clock of their own.
class WatchedServo {
 public:
  explicit WatchedServo(std::optional<milliseconds> interval) : watchdog_(interval) {}

  // Whether the watchdog is fed after so many more ticks in this time.
  bool IsFed(std::uint64_t ticks, milliseconds time) {
    now_ += time;
    ticks_ += ticks;
    return watchdog_.IsDue(ticks_, now_);
  }
  milliseconds now() const {
    return std::chrono::duration_cast<milliseconds>(now_.time_since_epoch());
  }

 private:
  ServoWatchdog watchdog_;
  ServoWatchdog::Time now_{std::chrono::hours(1)};
  std::uint64_t ticks_ = 0;
};

constexpr milliseconds kLook = ServoWatchdog::kLookPeriod;
constexpr milliseconds kNow{0};

TEST(Watchdog, IsFedOnlyWhileTheServoTicks) {
  // Neither before the first tick, nor where there is no watchdog.
  EXPECT_FALSE(WatchedServo(milliseconds(400)).IsFed(0, kNow));
  EXPECT_FALSE(WatchedServo(std::nullopt).IsFed(1000, kNow));
  WatchedServo servo(milliseconds(400));
  EXPECT_TRUE(servo.IsFed(1, kNow));
  // Ticks, but it was fed just now.
  EXPECT_FALSE(servo.IsFed(49, milliseconds(50)));
  EXPECT_TRUE(servo.IsFed(50, milliseconds(50)));
  // Stuck: for however long.
  for (int n = 0; n < 100; ++n) EXPECT_FALSE(servo.IsFed(0, milliseconds(100)));
  // One tick is not yet a servo that runs.
  EXPECT_FALSE(servo.IsFed(1, kNow));
  EXPECT_FALSE(servo.IsFed(1, milliseconds(100)));
  EXPECT_TRUE(servo.IsFed(100, milliseconds(100)));
}

TEST(Watchdog, AServoRunsWithHalfOfItsTicks) {
  EXPECT_TRUE(ServoRan(500, std::chrono::seconds(1)));
  EXPECT_FALSE(ServoRan(499, std::chrono::seconds(1)));
  EXPECT_FALSE(ServoRan(1, milliseconds(100)));
  EXPECT_FALSE(ServoRan(0, kNow));
  EXPECT_TRUE(ServoRan(1, kNow));  // of no time that was judged
}

// One that makes `ticks` of every 100, with a watchdog of 5 s, looked at for 20 s.
TEST(Watchdog, AServoThatLimpsStarvesIt) {
  const auto feeds_of = [](std::uint64_t ticks) {
    WatchedServo servo(std::chrono::seconds(5));
    EXPECT_TRUE(servo.IsFed(1, kNow));
    int feeds = 0;
    for (int look = 0; look < 200; ++look) feeds += servo.IsFed(ticks, kLook);
    return feeds;
  };
  EXPECT_EQ(feeds_of(100), 15);  // every 1.3 s: looks are 0.1 s apart
  EXPECT_EQ(feeds_of(60), 15);
  EXPECT_EQ(feeds_of(40), 0);
  EXPECT_EQ(feeds_of(1), 0);
}

// Four quarters at most are judged within an interval, so that one of them suffices.
TEST(Watchdog, AServoThatRecoversIsFedInTime) {
  WatchedServo servo(std::chrono::seconds(5));
  ASSERT_TRUE(servo.IsFed(1, kNow));
  const milliseconds fed = servo.now();
  for (int look = 0; look < 20; ++look) EXPECT_FALSE(servo.IsFed(0, kLook));
  while (!servo.IsFed(100, kLook)) {
  }
  EXPECT_LE(servo.now() - fed, std::chrono::seconds(4));
}

// Neither the servo nor who looks at it ran: it is judged by the rest.
TEST(Watchdog, AMachineThatStoodStillIsForgiven) {
  constexpr std::chrono::seconds kStill(3);
  WatchedServo servo(std::chrono::seconds(5));
  ASSERT_TRUE(servo.IsFed(1, kNow));
  for (int n = 0; n < 10; ++n) {
    for (int look = 0; look < 10; ++look) EXPECT_FALSE(servo.IsFed(60, kLook));
    EXPECT_TRUE(servo.IsFed(1, kStill));
  }
  // It hardly does anything else.
  for (int n = 0; n < 10; ++n) EXPECT_TRUE(servo.IsFed(1, kStill));
  // But a servo that does not tick is stuck, whatever the machine does.
  for (int n = 0; n < 10; ++n) {
    EXPECT_FALSE(servo.IsFed(0, kStill));
    for (int look = 0; look < 30; ++look) EXPECT_FALSE(servo.IsFed(0, kLook));
  }
}

TEST(ThreadStacks, AreSmallFromThenOn) {
  const auto stack_bytes = [] {
    pthread_attr_t attributes;
    std::size_t bytes = 0;
    pthread_getattr_np(pthread_self(), &attributes);
    pthread_attr_getstacksize(&attributes, &bytes);
    pthread_attr_destroy(&attributes);
    return bytes;
  };
  const SmallThreadStacks stacks;
  std::size_t bytes = 0;
  std::thread([&] { bytes = stack_bytes(); }).join();
  EXPECT_EQ(bytes, kThreadStackBytes);
  EXPECT_EQ(tbb::global_control::active_value(tbb::global_control::thread_stack_size),
            kThreadStackBytes);
}

}  // namespace
}  // namespace palpate::test
