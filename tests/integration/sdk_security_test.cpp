// The client library over TLS: whom it trusts, how it is known, and what it says where
// one of the two fails.
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <mutex>
#include <sstream>
#include <vector>

#ifndef __has_feature
#define __has_feature(feature) 0  // clang's
#endif
#if __has_feature(address_sanitizer)
#include <sanitizer/lsan_interface.h>
#endif

#include "client/sdk/client.h"
#include "tests/support/certificates.h"
#include "tests/support/daemon.h"
#include "tests/support/excuse.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"

namespace palpate::client {
namespace {

using namespace std::chrono_literals;
using test::Eventually;

#if __has_feature(address_sanitizer)
// Leaks are looked for while OpenSSL is still there. It goes at exit, before gRPC's threads do,
// and what they have of it would look lost: errors of handshakes that failed.
class LeaksBeforeTheEnd : public ::testing::Environment {
 public:
  void TearDown() override {
    EXPECT_TRUE(Eventually([] { return __lsan_do_recoverable_leak_check() == 0; }, 10s));
    __lsan_do_leak_check();  // the last one
  }
};
[[maybe_unused]] const auto* const kLeaksBeforeTheEnd =
    ::testing::AddGlobalTestEnvironment(new LeaksBeforeTheEnd);
#endif

int FreePort() {
  const int probe = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t length = sizeof(address);
  bind(probe, reinterpret_cast<sockaddr*>(&address), length);
  getsockname(probe, reinterpret_cast<sockaddr*>(&address), &length);
  close(probe);
  return ntohs(address.sin_port);
}

std::string ReadFile(const std::filesystem::path& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

std::size_t Count(const std::string& text, const std::string& what) {
  std::size_t count = 0;
  for (std::size_t at = text.find(what); at != text.npos; at = text.find(what, at + 1)) ++count;
  return count;
}

class SdkSecurity : public ::testing::Test, protected test::Certificates {
 protected:
  SdkSecurity() {
    MakeAuthority("lab");
    Issue("lab", "server", "DNS:localhost", 10, "serverAuth");
  }

  // Its certificate is for localhost alone.
  void StartDaemon() {
    std::ofstream(In("palpated.toml"))
        << "[tls]\ncertificate = \"" << In("server.pem").string() << "\"\nkey = \""
        << In("server.key").string() << "\"\nclient_ca = \"" << In("lab.pem").string()
        << "\"\ntokens = \"" << In("tokens.toml").string()
        << "\"\n[[tls.client]]\nsan = \"viewer.example\"\nrole = \"viewer\"\n"
        << "[[tls.client]]\nsan = \"operator.example\"\nrole = \"operator\"\n";
    AddToken("editor", "editor");
    daemon_.emplace(test::kPalpated, std::vector<std::string>{"--volume", "builtin:sphere:32",
                                                              "--config", In("palpated.toml"),
                                                              "--listen", "127.0.0.1:" + port_});
  }
  // Into `name`.token.
  void AddToken(const std::string& name, const std::string& role) const {
    Palpated("add " + name + " --role " + role, name + ".token");
  }
  void RevokeToken(const std::string& name) const { Palpated("revoke " + name, "revoked"); }

  ClientOptions With(const Credentials& credentials, const std::string& host = "localhost") const {
    return {.address = {.host_port = host + ":" + port_}, .credentials = credentials};
  }
  Credentials Token(const std::string& name) const {
    return {.ca_file = In("lab.pem"), .token_file = In(name + ".token")};
  }
  Credentials Certificate(const std::string& name) const {
    return {.ca_file = In("lab.pem"),
            .certificate_file = In(name + ".pem"),
            .key_file = In(name + ".key")};
  }
  // Why a client with these does not get in.
  std::string Refusal(const ClientOptions& options) const {
    const Client client(options);
    EXPECT_TRUE(Eventually([&] { return client.connection().state == ConnectionState::kLost; }));
    EXPECT_FALSE(client.WaitUntilConnected(1s));
    const std::string why = client.connection().why;
    EXPECT_EQ(why.find('\n'), std::string::npos) << why;
    return why;
  }
  // What the daemon said until its end.
  std::string EndDaemon() { return daemon_->End().error; }

  const std::string port_ = std::to_string(FreePort());
  std::optional<test::Daemon> daemon_;

 private:
  void Palpated(const std::string& arguments, const std::string& output) const {
    const std::string command = std::string(test::kPalpated) + " token " + arguments + " --file " +
                                In("tokens.toml").string() + " >" + In(output).string() +
                                " 2>/dev/null";
    ASSERT_EQ(std::system(command.c_str()), 0) << command;
  }
};

void ExpectDenied(const std::function<void()>& call, const std::string& line) {
  try {
    call();
    ADD_FAILURE() << "allowed";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kPermissionDenied);
    EXPECT_NE(std::string(error.what()).find(line), std::string::npos) << error.what();
  }
}

TEST_F(SdkSecurity, ATokenHasItsRole) {
  StartDaemon();
  Client client(With(Token("editor")));
  ASSERT_TRUE(client.WaitUntilConnected(60s)) << client.connection().why;
  ASSERT_TRUE(Eventually([&] { return client.NewestPose().has_value(); }));
  EXPECT_EQ(client.Set({.stiffness_n_per_mm = 0.7}).settings.stiffness_n_per_mm, 0.7);
  ExpectDenied([&] { client.EnableForces(); }, "needs the role operator, and 'token editor'");
  client.StopForces();
}

TEST_F(SdkSecurity, ACertificateHasTheRoleOfItsName) {
  Issue("lab", "viewer", "DNS:viewer.example");
  Issue("lab", "operator", "DNS:operator.example");
  StartDaemon();
  Client viewer(With(Certificate("viewer")));
  Client operating(With(Certificate("operator")));
  ASSERT_TRUE(viewer.WaitUntilConnected(60s)) << viewer.connection().why;
  ASSERT_TRUE(operating.WaitUntilConnected(60s)) << operating.connection().why;
  ExpectDenied([&] { viewer.Set({.stiffness_n_per_mm = 0.7}); }, "needs the role editor");
  operating.EnableForces();
}

TEST_F(SdkSecurity, StrangersAreToldWhy) {
  MakeAuthority("other");
  Issue("other", "fake", "DNS:operator.example");
  Issue("lab", "old", "DNS:operator.example", -1);
  Issue("lab", "unnamed", "DNS:nobody.example");
  std::ofstream(In("wrong.token")) << "palpate_" << std::string(43, 'A') << "\n";
  StartDaemon();
  const std::vector<std::pair<Credentials, std::string>> cases = {
      {{.ca_file = In("lab.pem")}, "neither a token nor a certificate came"},
      {Certificate("fake"), "its certificate is refused"},
      {Certificate("old"), "expired"},
      {Certificate("unnamed"), "(nobody.example) have no role"},
      {Token("wrong"), "its token is unknown, or was revoked"}};
  for (const auto& [credentials, why] : cases) {
    EXPECT_NE(Refusal(With(credentials)).find(why), std::string::npos) << why;
  }
  const std::string log = EndDaemon();
  for (const auto& [credentials, why] : cases) {
    EXPECT_NE(log.find("refused a stranger at ipv4:127.0.0.1:"), std::string::npos);
    EXPECT_NE(log.find(why), std::string::npos) << why;
  }
}

TEST_F(SdkSecurity, TheDaemonProvesItself) {
  MakeAuthority("other");
  StartDaemon();
  Credentials credentials = Token("editor");
  // Not the name that its certificate is for.
  EXPECT_NE(Refusal(With(credentials, "127.0.0.1")).find("does not name 127.0.0.1"),
            std::string::npos);
  credentials.ca_file = In("other.pem");
  EXPECT_NE(Refusal(With(credentials))
                .find("is not signed by the authority in " + std::string(In("other.pem"))),
            std::string::npos);
  // No client of that authority got as far as sending its token.
  EXPECT_EQ(EndDaemon().find("refused"), std::string::npos);
}

// palpated itself does not start with such a certificate.
TEST_F(SdkSecurity, AnExpiredDaemonIsNotTrusted) {
  Issue("lab", "expired", "DNS:localhost", -1, "serverAuth");
  AddToken("editor", "editor");
  grpc::SslServerCredentialsOptions options;
  options.pem_key_cert_pairs.push_back({ReadFile(In("expired.key")), ReadFile(In("expired.pem"))});
  grpc::ServerBuilder builder;
  builder.AddListeningPort("127.0.0.1:" + port_, grpc::SslServerCredentials(options));
  v1::RenderService::Service service;
  builder.RegisterService(&service);
  const auto server = builder.BuildAndStart();
  ASSERT_TRUE(server);
  EXPECT_NE(Refusal(With(Token("editor"))).find("that proves itself"), std::string::npos);
}

TEST_F(SdkSecurity, FilesThatCannotBeUsedAreNamedAtOnce) {
  Issue("lab", "viewer", "DNS:viewer.example");
  std::ofstream(In("empty"));
  std::ofstream(In("garbage")) << "-----BEGIN NOTHING-----\n";
  std::ofstream(In("two.token")) << "palpate_a\npalpate_b\n";
  std::ofstream(In("garbage.token")) << std::string(200, 'x');
  std::filesystem::create_directory(In("folder"));
  const auto refusal = [&](Credentials credentials) {
    try {
      const Client client(With(credentials));
    } catch (const Error& error) {
      const std::string line = error.what();
      EXPECT_EQ(line.find('\n'), std::string::npos) << line;
      return line;
    }
    return std::string("taken");
  };
  for (const char* name : {"absent", "empty", "folder", "garbage"}) {
    SCOPED_TRACE(name);
    const std::string path = In(name);
    Credentials credentials = Certificate("viewer");
    credentials.ca_file = path;
    EXPECT_NE(refusal(credentials).find(path), std::string::npos) << refusal(credentials);
    credentials = Certificate("viewer");
    credentials.certificate_file = path;
    EXPECT_NE(refusal(credentials).find(path), std::string::npos) << refusal(credentials);
    credentials = Certificate("viewer");
    credentials.key_file = path;
    EXPECT_NE(refusal(credentials).find(path), std::string::npos) << refusal(credentials);
  }
  for (const char* name : {"absent", "two", "garbage"}) {
    EXPECT_NE(refusal(Token(name)).find(In(std::string(name) + ".token").string()),
              std::string::npos)
        << name;
  }
  // What could not be sent safely, or is half given.
  for (const Credentials& credentials :
       {Credentials{.token_file = In("two.token")},
        Credentials{.ca_file = In("lab.pem"), .certificate_file = In("viewer.pem")},
        Credentials{.ca_file = In("lab.pem"), .key_file = In("viewer.key")}}) {
    EXPECT_THROW(Client(With(credentials)), Error);
  }
  EXPECT_THROW(Client({.address = {.socket_path = In("s")}, .credentials = {.ca_file = "x"}}),
               Error);
}

TEST_F(SdkSecurity, OneSideWithoutTlsIsSaid) {
  StartDaemon();
  EXPECT_NE(Refusal(With({})).find("TLS"), std::string::npos);
  daemon_.reset();
  daemon_.emplace(test::kPalpated, std::vector<std::string>{"--volume", "builtin:sphere:32",
                                                            "--listen", "127.0.0.1:" + port_});
  EXPECT_NE(Refusal(With(Token("editor"))).find("has no TLS"), std::string::npos);
}

TEST_F(SdkSecurity, ARevokedTokenEndsThePosesAndDoesNotHammer) {
  StartDaemon();
  AddToken("leaver", "viewer");
  std::mutex mutex;
  std::vector<Connection> seen;
  ClientOptions options = With(Token("leaver"));
  options.follow_volume = true;
  options.callbacks.on_connection = [&](const Connection& connection) {
    const std::lock_guard lock(mutex);
    seen.push_back(connection);
  };
  const Client client(options);
  ASSERT_TRUE(client.WaitUntilConnected(60s)) << client.connection().why;
  ASSERT_TRUE(Eventually([&] { return client.NewestPose().has_value(); }));
  RevokeToken("leaver");
  ASSERT_TRUE(Eventually([&] {
    return client.connection().why.find("its token is unknown, or was revoked") !=
           std::string::npos;
  }));
  const auto tick = client.NewestPose()->tick;
  std::this_thread::sleep_for(10s);
  EXPECT_EQ(client.NewestPose()->tick, tick);
  {
    // Connecting is not said anew, nor the same reason.
    const std::lock_guard lock(mutex);
    EXPECT_EQ(seen.back().state, ConnectionState::kLost);
    EXPECT_LE(seen.size(), 4u);
  }
  // A new token in the same file: it comes back by itself.
  AddToken("leaver", "viewer");
  ASSERT_TRUE(client.WaitUntilConnected(60s)) << client.connection().why;
  ASSERT_TRUE(Eventually([&] { return client.NewestPose()->tick > tick; }));
  const std::string log = EndDaemon();
  EXPECT_NE(log.find("ended /palpate.v1.PoseService/StreamPoses of token leaver at ipv4:"),
            std::string::npos);
  EXPECT_NE(log.find("ended /palpate.v1.VolumeService/StreamVolume of token leaver at ipv4:"),
            std::string::npos);
  // Pauses of 0.05 s at least, doubled to 2.5 s at least: 11 in ten seconds and the two
  // until the new token is known. The volume's stream has attempts of its own.
  EXPECT_LE(Count(log, "refused a stranger"), 2 * 12u) << test::kBusyMachine;
  EXPECT_GE(Count(log, "refused a stranger"), 3u);
}

TEST_F(SdkSecurity, ARotatedCertificateHindersNoClient) {
  StartDaemon();
  AddToken("other", "viewer");
  std::ofstream(In("trusted.pem")) << ReadFile(In("lab.pem"));
  Credentials credentials = Token("editor");
  credentials.ca_file = In("trusted.pem");
  const Client client(With(credentials));
  ASSERT_TRUE(client.WaitUntilConnected(60s)) << client.connection().why;
  ASSERT_TRUE(Eventually([&] { return client.NewestPose().has_value(); }));

  // Of another authority, so that it shows which of the two is served.
  MakeAuthority("next");
  Issue("next", "renewed", "DNS:localhost", 10, "serverAuth");
  std::filesystem::rename(In("renewed.key"), In("server.key"));
  std::filesystem::rename(In("renewed.pem"), In("server.pem"));
  daemon_->process().Signal(SIGHUP);
  Credentials late = Token("other");
  late.ca_file = In("next.pem");
  const Client newcomer(With(late));
  ASSERT_TRUE(newcomer.WaitUntilConnected(60s)) << newcomer.connection().why;
  EXPECT_NE(Refusal(With(Token("other"))).find("that proves itself"), std::string::npos);

  // Who streams goes on, and comes back with the new authority's file.
  EXPECT_EQ(client.connection().state, ConnectionState::kConnected);
  const auto tick = client.NewestPose()->tick;
  ASSERT_TRUE(Eventually([&] { return client.NewestPose()->tick > tick + 100; }));
  std::ofstream(In("trusted.pem"), std::ios::app) << ReadFile(In("next.pem"));
  RevokeToken("editor");
  ASSERT_TRUE(Eventually([&] { return client.connection().state == ConnectionState::kLost; }));
  AddToken("editor", "editor");
  ASSERT_TRUE(client.WaitUntilConnected(60s)) << client.connection().why;
  const auto again = client.NewestPose()->tick;
  ASSERT_TRUE(Eventually([&] { return client.NewestPose()->tick > again + 100; }));
}

}  // namespace
}  // namespace palpate::client
