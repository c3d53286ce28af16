// Who may connect: the places that are kept for the socket, and which strangers are cut off.
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
#include <filesystem>
#include <iterator>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/files/descriptor.h"
#include "server/door/acceptor.h"
#include "server/door/connection_watch.h"
#include "server/door/entrance.h"
#include "tests/support/free_port.h"
#include "tests/support/patience.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

using test::Eventually;

// Files of these tests have numbers from here on, out of the way of what is counted.
constexpr int kOwnFiles = 600;

Descriptor Moved(int fd) {
  Descriptor low(fd);
  return Descriptor(fcntl(low.get(), F_DUPFD_CLOEXEC, kOwnFiles));
}

sockaddr_in Loopback(int port, const std::string& host = "127.0.0.1") {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<in_port_t>(port));
  EXPECT_EQ(inet_pton(AF_INET, host.c_str(), &address.sin_addr), 1);
  return address;
}

Descriptor ConnectTo(int port, const std::string& from = "127.0.0.1") {
  Descriptor file = Moved(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const sockaddr_in own = Loopback(0, from);
  EXPECT_EQ(bind(file.get(), reinterpret_cast<const sockaddr*>(&own), sizeof own), 0);
  const sockaddr_in address = Loopback(port);
  EXPECT_EQ(connect(file.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  return file;
}

Descriptor ConnectTo(const std::string& path) {
  Descriptor file = Moved(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
  EXPECT_EQ(connect(file.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  return file;
}

// Whether the other side has hung up.
bool IsClosed(const Descriptor& file) {
  char byte = 0;
  const ssize_t read = recv(file.get(), &byte, 1, MSG_DONTWAIT);
  return read == 0 || (read < 0 && errno == ECONNRESET);
}

// Keeps what the acceptor gives it, as gRPC would.
class KeepingSink final : public grpc::experimental::ExternalConnectionAcceptor {
 public:
  KeepingSink(std::atomic<int>& count, std::vector<Descriptor>& kept)
      : count_(count), kept_(kept) {}
  void HandleNewConnection(NewConnectionParameters* connection) override {
    kept_.emplace_back(connection->fd);
    ++count_;
  }

 private:
  std::atomic<int>& count_;
  std::vector<Descriptor>& kept_;
};

// Connects until one is refused. A number that another thread gives back meanwhile makes room for
// one more.
template <typename Connect>
void FillUp(const std::atomic<int>& count, std::vector<Descriptor>& clients, Connect connect) {
  for (int before = count; before < kOwnFiles; before = count) {
    clients.push_back(connect());
    ASSERT_TRUE(Eventually([&] { return count > before || IsClosed(clients.back()); }));
    if (count == before) return;
  }
  FAIL() << "all were let in";
}

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
  std::vector<Descriptor> from_socket, from_port, clients, fillers;
  Acceptor at_socket(kFirstRefused + Entrance::kKeptFiles, watch), at_port(kFirstRefused, watch);
  at_socket.TakeSocket(path, 0660, std::nullopt, nullptr);
  at_port.TakePort({"127.0.0.1", static_cast<std::uint16_t>(port)}, Role::kViewer);
  watch.Start();
  at_socket.Start(std::make_unique<KeepingSink>(on_socket, from_socket));
  at_port.Start(std::make_unique<KeepingSink>(on_port, from_port));
  // All numbers that the port may use are taken.
  for (int fd = 0; fd < kFirstRefused - 1;) {
    fd = open("/dev/null", O_RDONLY | O_CLOEXEC);
    ASSERT_GE(fd, 0);
    fillers.emplace_back(fd);
  }
  FillUp(on_port, clients, [&] { return ConnectTo(port); });
  FillUp(on_socket, clients, [&] { return ConnectTo(path); });
  at_socket.Stop();
  at_port.Stop();
  const auto last = [](const std::vector<Descriptor>& files) {
    int highest = 0;
    for (const Descriptor& file : files) highest = std::max(highest, file.get());
    return highest;
  };
  EXPECT_LT(last(from_port), kFirstRefused);
  EXPECT_GE(on_socket, kKept);
  EXPECT_EQ(last(from_socket), kFirstRefused + kKept - 1);
}

// Connections over loopback, entered as the acceptor does.
class ConnectionWatchTest : public ::testing::Test {
 protected:
  struct Pair {
    Descriptor client{}, server{};
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

  Pair Enter(const std::string& from = "127.0.0.1") {
    Pair pair{.client = ConnectTo(port_, from)};
    socklen_t size = sizeof pair.peer;
    pair.server = Moved(accept4(listener_.get(), reinterpret_cast<sockaddr*>(&pair.peer), &size,
                                SOCK_CLOEXEC | SOCK_NONBLOCK));
    EXPECT_TRUE(watch_.Enter(pair.server.get(), pair.peer));
    return pair;
  }

  void Admit(const Pair& pair, Role role) {
    watch_.Admitted(PeerName(pair.peer), {.token_sha256_hex = "a"}, role);
  }

  // Who has this token is an editor; all others are not known any more.
  void KnowOnly(const std::string& token) {
    watch_.Judge([&](const Credentials& one) {
      return one.token_sha256_hex == token ? std::optional(Role::kEditor) : std::nullopt;
    });
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

  static std::ptrdiff_t OpenFiles() {
    return std::distance(std::filesystem::directory_iterator("/proc/self/fd"), {});
  }

  static constexpr std::int64_t kMiB = 1 << 20;
  ConnectionWatch watch_{kOwnFiles};
  int port_ = 0;
  Descriptor listener_;
};

// The review that cuts one off has seen both.
TEST_F(ConnectionWatchTest, AStrangerWhoSendsTooMuchIsCutOff) {
  const Pair modest = Enter(), greedy = Enter();
  EXPECT_TRUE(Send(modest, kLittleIdleBytes / 2));
  Send(greedy, kIdleBytesOfOne + kMiB);
  EXPECT_TRUE(Eventually([&] { return IsClosed(greedy.client); }));
  EXPECT_FALSE(IsClosed(modest.client));
}

TEST_F(ConnectionWatchTest, WhatHasComeOfACutOffConnectionIsDropped) {
  const Pair greedy = Enter();
  Send(greedy, kIdleBytesOfOne);
  const std::vector<char> more(kIdleBytesOfOne / 4);
  ASSERT_GT(send(greedy.client.get(), more.data(), more.size(), MSG_DONTWAIT | MSG_NOSIGNAL), 0);
  EXPECT_TRUE(Eventually([&] { return IsClosed(greedy.client); }));
  char byte = 0;
  EXPECT_LE(recv(greedy.server.get(), &byte, 1, MSG_DONTWAIT), 0);
}

TEST_F(ConnectionWatchTest, ANewcomerGetsInAmongManyAddressesAndTheOldestGoes) {
  std::vector<Pair> crowd;
  for (int n = 1; n <= 64; ++n) crowd.push_back(Enter("127.0.1." + std::to_string(n)));
  const Pair newcomer = Enter("127.0.0.1");
  EXPECT_TRUE(Eventually([&] { return IsClosed(crowd.front().client); }));
  EXPECT_FALSE(IsClosed(newcomer.client));
  for (std::size_t n = 1; n < crowd.size(); ++n) EXPECT_FALSE(IsClosed(crowd[n].client)) << n;
}

TEST_F(ConnectionWatchTest, AKnownClientIsNotWatchedUntilItIsKnownNoMore) {
  Pair known = Enter(), other = Enter();
  watch_.Admitted(PeerName(known.peer), {.token_sha256_hex = "a"}, Role::kEditor);
  watch_.Admitted(PeerName(other.peer), {.token_sha256_hex = "b"}, Role::kEditor);
  const Pair greedy = Enter();
  EXPECT_TRUE(Send(known, 9 * kMiB));
  EXPECT_TRUE(Send(other, 9 * kMiB));
  Send(greedy, 9 * kMiB);
  // A review that would have cut off all.
  EXPECT_TRUE(Eventually([&] { return IsClosed(greedy.client); }));
  EXPECT_FALSE(IsClosed(known.client));
  KnowOnly("b");
  EXPECT_TRUE(Eventually([&] { return IsClosed(known.client); }));
  EXPECT_FALSE(IsClosed(other.client));
  // The second file of a connection that has ended goes too.
  const auto look = [&] { KnowOnly("b"); };
  look();  // forgets those that it cut off
  const std::ptrdiff_t before = OpenFiles();
  other.client = Descriptor();
  EXPECT_TRUE(Eventually([&] {
    look();
    return OpenFiles() == before - 2;  // with the client's own
  }));
}

TEST_F(ConnectionWatchTest, AViewerWhoSendsForNothingIsCutOffAndAnEditorIsNot) {
  const Pair modest = Enter(), viewer = Enter(), editor = Enter();
  for (const Pair* pair : {&modest, &viewer}) Admit(*pair, Role::kViewer);
  Admit(editor, Role::kEditor);
  EXPECT_TRUE(Send(modest, kLittleIdleBytes / 2));
  EXPECT_TRUE(Send(editor, 64 * kMiB));
  Send(viewer, 64 * kMiB);
  EXPECT_TRUE(Eventually([&] { return IsClosed(viewer.client); }));
  EXPECT_FALSE(IsClosed(modest.client));
  EXPECT_FALSE(IsClosed(editor.client));
  // An editor who has become a viewer.
  watch_.Judge([](const Credentials&) { return std::optional(Role::kViewer); });
  Send(editor, 64 * kMiB);
  EXPECT_TRUE(Eventually([&] { return IsClosed(editor.client); }));
}

TEST_F(ConnectionWatchTest, AdmittedCallsAndSamplesPayForTheirBytes) {
  const Pair caller = Enter(), taker = Enter();
  for (int n = 0; n < 4 * kIdleBytesOfOne / kBytesPerCall; ++n) {
    Admit(caller, Role::kViewer);
    ASSERT_TRUE(Send(caller, kBytesPerCall));
  }
  Admit(taker, Role::kViewer);
  watch_.TakesSamples(PeerName(taker.peer), 1 << 30);
  EXPECT_TRUE(Send(taker, 4 * kIdleBytesOfOne));
  watch_.TakesSamples(PeerName(taker.peer), -(1 << 30));
  Send(taker, 64 * kMiB);
  EXPECT_TRUE(Eventually([&] { return IsClosed(taker.client); }));
  EXPECT_FALSE(IsClosed(caller.client));
}

TEST_F(ConnectionWatchTest, ManyViewersAreBoundedTogetherAlsoIfTheyComeAgain) {
  const Pair quiet = Enter();
  Admit(quiet, Role::kViewer);
  EXPECT_TRUE(Send(quiet, kLittleIdleBytes / 2));
  const auto crowd = [&] {
    std::vector<Pair> pairs;
    for (int n = 0; n < 16; ++n) {
      pairs.push_back(Enter());
      Admit(pairs.back(), Role::kViewer);
      Send(pairs.back(), kIdleBytesOfOne * 3 / 4);
    }
    return Eventually([&] { return IsClosed(pairs.back().client); });
  };
  EXPECT_TRUE(crowd());
  EXPECT_TRUE(crowd());
  EXPECT_FALSE(IsClosed(quiet.client));
}

// A token may be renewed while its connection stays, and a client may be allowed again.
TEST_F(ConnectionWatchTest, TheNewestCredentialsCount) {
  const Pair known = Enter();
  const auto admit = [&](const char* token) {
    watch_.Admitted(PeerName(known.peer), {.token_sha256_hex = token}, Role::kEditor);
  };
  admit("a");
  admit("b");
  KnowOnly("b");
  KnowOnly("c");
  admit("d");
  KnowOnly("d");
  EXPECT_TRUE(Send(known, 9 * kMiB));
  const Pair greedy = Enter();
  Send(greedy, 9 * kMiB);
  EXPECT_TRUE(Eventually([&] { return IsClosed(greedy.client); }));
  EXPECT_FALSE(IsClosed(known.client));
  KnowOnly("a");
  EXPECT_TRUE(Eventually([&] { return IsClosed(known.client); }));
}

}  // namespace
}  // namespace palpate
