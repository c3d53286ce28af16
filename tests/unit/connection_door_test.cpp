// Who may connect: the places that are kept for the socket, and how long the address of
// somebody who sent too much is kept out.
#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/rpc/acceptor.h"
#include "server/rpc/connection_watch.h"
#include "tests/support/free_port.h"
#include "tests/support/patience.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using test::Eventually;

constexpr std::int64_t kSecondNs = 1'000'000'000;
// Files of these tests have numbers from here on, out of the way of what is counted.
constexpr int kOwnFiles = 600;

// A file that closes itself.
class OwnedFile {
 public:
  explicit OwnedFile(int fd = -1) : fd_(fd) {}
  ~OwnedFile() {
    if (fd_ >= 0) close(fd_);
  }
  OwnedFile(OwnedFile&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  OwnedFile& operator=(OwnedFile&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  int get() const { return fd_; }

 private:
  int fd_;
};

OwnedFile Moved(int fd) {
  OwnedFile low(fd);
  return OwnedFile(fcntl(low.get(), F_DUPFD_CLOEXEC, kOwnFiles));
}

sockaddr_in Loopback(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<in_port_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

OwnedFile ConnectTo(int port) {
  OwnedFile file = Moved(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const sockaddr_in address = Loopback(port);
  EXPECT_EQ(connect(file.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  return file;
}

OwnedFile ConnectTo(const std::string& path) {
  OwnedFile file = Moved(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
  EXPECT_EQ(connect(file.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  return file;
}

// Whether the other side has hung up.
bool IsClosed(const OwnedFile& file) {
  char byte = 0;
  const ssize_t read = recv(file.get(), &byte, 1, MSG_DONTWAIT);
  return read == 0 || (read < 0 && errno == ECONNRESET);
}

// Keeps what the acceptor gives it, as gRPC would.
class KeepingSink final : public grpc::experimental::ExternalConnectionAcceptor {
 public:
  KeepingSink(std::atomic<int>& count, std::vector<OwnedFile>& kept) : count_(count), kept_(kept) {}
  void HandleNewConnection(NewConnectionParameters* connection) override {
    kept_.emplace_back(connection->fd);
    ++count_;
  }

 private:
  std::atomic<int>& count_;
  std::vector<OwnedFile>& kept_;
};

TEST(Acceptor, AFullPortLeavesTheSocketSixtyFourPlaces) {
  constexpr int kFirstRefused = 300, kKept = 64;
  rlimit limit{};
  getrlimit(RLIMIT_NOFILE, &limit);
  limit.rlim_cur = std::min<rlim_t>(limit.rlim_max, 1024);
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &limit), 0);
  const test::TemporaryFolder folder;
  const std::string path = folder.path() / "s.sock";
  const int port = test::FreePort();
  ConnectionWatch watch(kOwnFiles);
  std::atomic<int> on_socket{0}, on_port{0};
  std::vector<OwnedFile> kept, clients, fillers;
  Acceptor acceptor(kFirstRefused, watch);
  acceptor.TakeSocket(path);
  acceptor.TakePort({"127.0.0.1", static_cast<std::uint16_t>(port)}, false);
  std::vector<Acceptor::Sink> sinks;
  sinks.push_back(std::make_unique<KeepingSink>(on_socket, kept));
  sinks.push_back(std::make_unique<KeepingSink>(on_port, kept));
  acceptor.Start(std::move(sinks));
  // All numbers that the port may use are taken.
  for (int fd = 0; fd < kFirstRefused - 1;) {
    fd = open("/dev/null", O_RDONLY | O_CLOEXEC);
    ASSERT_GE(fd, 0);
    fillers.emplace_back(fd);
  }
  clients.push_back(ConnectTo(port));
  EXPECT_TRUE(Eventually([&] { return IsClosed(clients.back()); }));
  for (int n = 1; n <= kKept; ++n) {
    clients.push_back(ConnectTo(path));
    ASSERT_TRUE(Eventually([&] { return on_socket == n || IsClosed(clients.back()); }));
    ASSERT_EQ(on_socket, n);
  }
  clients.push_back(ConnectTo(path));
  EXPECT_TRUE(Eventually([&] { return IsClosed(clients.back()); }));
  EXPECT_EQ(on_socket, kKept);
  EXPECT_EQ(on_port, 0);
  acceptor.Stop();
}

// Connections over loopback, entered as the acceptor does.
class ConnectionWatchTest : public ::testing::Test {
 protected:
  struct Pair {
    OwnedFile client{}, server{};
    sockaddr_storage peer{};
  };

  void SetUp() override {
    port_ = test::FreePort();
    listener_ = Moved(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    const sockaddr_in address = Loopback(port_);
    ASSERT_EQ(bind(listener_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address),
              0);
    ASSERT_EQ(listen(listener_.get(), 8), 0);
    watch_.Start();
  }

  Pair Connect() {
    Pair pair{.client = ConnectTo(port_)};
    socklen_t size = sizeof pair.peer;
    pair.server = Moved(accept4(listener_.get(), reinterpret_cast<sockaddr*>(&pair.peer), &size,
                                SOCK_CLOEXEC | SOCK_NONBLOCK));
    return pair;
  }
  bool Enters() {
    const Pair pair = Connect();
    return watch_.Enter(pair.server.get(), pair.peer);
  }

  // So much comes, and is read by the server. False: it was cut off before.
  static bool Send(const Pair& pair, std::int64_t bytes) {
    std::vector<char> piece(1 << 16);
    std::int64_t sent = 0, received = 0;
    while (received < bytes) {
      const auto size = static_cast<std::size_t>(std::min<std::int64_t>(bytes - sent, 1 << 16));
      const ssize_t more = send(pair.client.get(), piece.data(), size, MSG_DONTWAIT | MSG_NOSIGNAL);
      if (more < 0 && errno != EAGAIN) return false;
      sent += std::max<ssize_t>(more, 0);
      const ssize_t read = recv(pair.server.get(), piece.data(), piece.size(), MSG_DONTWAIT);
      if (read == 0) return false;
      received += std::max<ssize_t>(read, 0);
    }
    return true;
  }
  // The connections are looked at twice: once at least with all that came before.
  void AwaitLooks() {
    const int before = looks_;
    EXPECT_TRUE(Eventually([&] { return looks_ >= before + 2; }));
  }
  // MiB that came before it was cut off, one after the other and each looked at.
  int SendUntilCutOff(const Pair& pair, int first_mib) {
    Send(pair, first_mib * kMiB);
    for (int mib = first_mib; mib < 1000; ++mib) {
      now_ns_ += kSecondNs / 10;  // known clients are due
      AwaitLooks();
      if (IsClosed(pair.client) || !Send(pair, kMiB)) return mib;
    }
    return 1000;
  }

  static constexpr std::int64_t kMiB = 1 << 20;
  std::atomic<std::int64_t> now_ns_{1000 * kSecondNs};
  std::atomic<int> looks_{0};
  ConnectionWatch watch_{kOwnFiles, [this] {
                           ++looks_;
                           return now_ns_.load();
                         }};
  int port_ = 0;
  OwnedFile listener_;
};

// deploy/README: 8 MiB on each connection.
TEST_F(ConnectionWatchTest, AStrangerIsCutOffBeyondEightMiB) {
  const Pair modest = Connect(), greedy = Connect();
  ASSERT_TRUE(watch_.Enter(modest.server.get(), modest.peer));
  ASSERT_TRUE(watch_.Enter(greedy.server.get(), greedy.peer));
  EXPECT_TRUE(Send(modest, 8 * kMiB - 1000));
  const int mib = SendUntilCutOff(greedy, 6);
  EXPECT_GE(mib, 8);  // within the ninth, or after it
  EXPECT_LE(mib, 9);
  EXPECT_FALSE(IsClosed(modest.client));
}

// deploy/README: 32 MiB on a connection that belong to no call.
TEST_F(ConnectionWatchTest, AKnownClientIsCutOffBeyondThirtyTwoMiB) {
  const Pair client = Connect();
  ASSERT_TRUE(watch_.Enter(client.server.get(), client.peer));
  watch_.Admitted(PeerName(client.peer), "token viewer");
  const int mib = SendUntilCutOff(client, 30);
  EXPECT_GE(mib, 32);
  EXPECT_LE(mib, 34);  // calls and seconds are granted some kilobytes each
}

TEST_F(ConnectionWatchTest, WhoSentTooMuchIsKeptOutForTenSeconds) {
  const Pair greedy = Connect();
  ASSERT_TRUE(watch_.Enter(greedy.server.get(), greedy.peer));
  Send(greedy, 9 * kMiB);
  EXPECT_TRUE(Eventually([&] { return IsClosed(greedy.client); }));
  EXPECT_FALSE(Enters());
  now_ns_ += 10 * kSecondNs - 1'000'000;
  EXPECT_FALSE(Enters());
  now_ns_ += 2'000'000;
  EXPECT_TRUE(Enters());
}

}  // namespace
}  // namespace palpate
