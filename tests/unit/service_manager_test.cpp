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
  EXPECT_TRUE(watchdog.IsDue(101, now));
}

TEST(Watchdog, IsNotFedBeforeTheFirstTickNorWhereThereIsNone) {
  ServoWatchdog::Time now{std::chrono::hours(1)};
  EXPECT_FALSE(ServoWatchdog(milliseconds(400)).IsDue(0, now));
  EXPECT_FALSE(ServoWatchdog(std::nullopt).IsDue(1000, now));
}

}  // namespace
}  // namespace palpate::test
