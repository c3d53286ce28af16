// The client library over TLS: whom it trusts, how it is known, and what it does where one of the
// two fails. Whom palpated lets in is python_security_test's.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>
#include <sstream>
#include <thread>
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
#include "tests/support/free_port.h"
#include "tests/support/heard.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/refusal.h"
#include "tests/support/stolen.h"

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
    EXPECT_TRUE(Eventually([] { return __lsan_do_recoverable_leak_check() == 0; }, 60s));
    __lsan_do_leak_check();  // the last one
  }
};
[[maybe_unused]] const auto* const kLeaksBeforeTheEnd =
    ::testing::AddGlobalTestEnvironment(new LeaksBeforeTheEnd);
#endif

std::string TextOf(const std::filesystem::path& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

bool Has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

class SdkSecurity : public ::testing::Test, protected test::Certificates {
 protected:
  SdkSecurity() {
    MakeAuthority("lab");
    MakeAuthority("other");
    Issue("lab", "server", "DNS:localhost", 10, "serverAuth");
    Issue("lab", "operator", "DNS:operator.example");
  }

  // Its certificate is for localhost alone.
  void StartDaemon() {
    std::ofstream(In("palpated.toml"))
        << "[tls]\ncertificate = \"" << In("server.pem").string() << "\"\nkey = \""
        << In("server.key").string() << "\"\nclient_ca = \"" << In("lab.pem").string()
        << "\"\ntokens = \"" << In("tokens.toml").string()
        << "\"\n[[tls.client]]\nsan = \"operator.example\"\nrole = \"operator\"\n";
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
  Credentials Token(const std::string& name, const std::string& ca = "lab.pem") const {
    return {.ca_file = In(ca), .token_file = In(name + ".token")};
  }
  Credentials Certificate() const {
    return {.ca_file = In("lab.pem"),
            .certificate_file = In("operator.pem"),
            .key_file = In("operator.key")};
  }
  // Why a client with these does not get in.
  std::string WhyNot(const ClientOptions& options) const {
    const Client client(options);
    EXPECT_TRUE(Eventually([&] { return client.connection().state == ConnectionState::kLost; }));
    EXPECT_FALSE(client.WaitUntilConnected(1s));
    return client.connection().why;
  }
  bool IsToldThatItWasRevoked(const Client& client) const {
    return Eventually([&] { return Has(client.connection().why, "revoked"); });
  }

  const std::string port_ = std::to_string(test::FreePort());
  std::optional<test::Daemon> daemon_;

 private:
  void Palpated(const std::string& arguments, const std::string& output) const {
    const std::string command = std::string(test::kPalpated) + " token " + arguments + " --file " +
                                In("tokens.toml").string() + " >" + In(output).string() +
                                " 2>/dev/null";
    ASSERT_EQ(std::system(command.c_str()), 0) << command;
  }
};

TEST_F(SdkSecurity, ATokenOrACertificateHasItsRole) {
  StartDaemon();
  Client editing(With(Token("editor")));
  Client operating(With(Certificate()));
  ASSERT_TRUE(editing.WaitUntilConnected(60s)) << editing.connection().why;
  ASSERT_TRUE(operating.WaitUntilConnected(60s)) << operating.connection().why;
  ASSERT_TRUE(Eventually([&] { return editing.NewestPose().has_value(); }));
  EXPECT_EQ(editing.Set({.stiffness_n_per_mm = 0.7}).settings.stiffness_n_per_mm, 0.7);
  EXPECT_EQ(testing::Refusal([&] { editing.EnableForces(); }), ErrorKind::kPermissionDenied);
  editing.StopForces();
  operating.EnableForces();
  EXPECT_TRUE(Has(WhyNot(With({.ca_file = In("lab.pem")})), "token"));
  EXPECT_TRUE(Has(WhyNot(With({})), "TLS"));
}

TEST_F(SdkSecurity, WhoProvesNothingIsNotTrustedAndToldApart) {
  StartDaemon();
  // Not the name that its certificate is for; not the authority that signed it.
  EXPECT_TRUE(Has(WhyNot(With(Token("editor"), "127.0.0.1")), "127.0.0.1"));
  EXPECT_TRUE(Has(WhyNot(With(Token("editor", "other.pem"))), In("other.pem")));
  // Neither got as far as sending its token.
  EXPECT_FALSE(Has(daemon_->End().error, "refused"));
  daemon_.reset();
  daemon_.emplace(test::kPalpated, std::vector<std::string>{"--volume", "builtin:sphere:32",
                                                            "--listen", "127.0.0.1:" + port_});
  EXPECT_TRUE(Has(WhyNot(With(Token("editor"))), "TLS"));
}

TEST_F(SdkSecurity, FilesThatCannotBeUsedAreNamedAtOnce) {
  std::ofstream(In("empty"));
  std::ofstream(In("garbage")) << "-----BEGIN NOTHING-----\n";
  std::ofstream(In("two.token")) << "palpate_a\npalpate_b\n";
  std::ofstream(In("garbage.token")) << std::string(200, 'x');
  std::filesystem::create_directory(In("folder"));
  const auto expect_named = [&](const Credentials& credentials, const std::string& path) {
    try {
      const Client client(With(credentials));
      ADD_FAILURE() << path << " was taken";
    } catch (const Error& error) {
      EXPECT_TRUE(Has(error.what(), path)) << error.what();
    }
  };
  for (const char* name : {"absent", "empty", "folder", "garbage"}) {
    for (const auto file :
         {&Credentials::ca_file, &Credentials::certificate_file, &Credentials::key_file}) {
      Credentials credentials = Certificate();
      credentials.*file = In(name);
      expect_named(credentials, In(name));
    }
  }
  for (const char* name : {"absent", "two", "garbage"}) {
    expect_named(Token(name), In(std::string(name) + ".token"));
  }
  // What could not be sent safely, or is half given.
  for (const Credentials& credentials :
       {Credentials{.token_file = In("two.token")},
        Credentials{.ca_file = In("lab.pem"), .certificate_file = In("operator.pem")},
        Credentials{.ca_file = In("lab.pem"), .key_file = In("operator.key")}}) {
    EXPECT_THROW(Client(With(credentials)), Error);
  }
  EXPECT_THROW(Client({.address = {.socket_path = In("s")}, .credentials = {.ca_file = "x"}}),
               Error);
}

// As with --token-file <(command). It can be read once.
TEST_F(SdkSecurity, ATokenMayComeThroughAPipe) {
  StartDaemon();
  ASSERT_EQ(mkfifo(In("pipe.token").c_str(), 0600), 0);
  std::thread writer([&] { std::ofstream(In("pipe.token")) << TextOf(In("editor.token")); });
  const Client client(With(Token("pipe")));
  writer.join();
  ASSERT_TRUE(client.WaitUntilConnected(60s)) << client.connection().why;
  EXPECT_TRUE(Eventually([&] { return client.NewestPose().has_value(); }));
}

// The daemon's certificate is replaced by one of another authority, which shows who is served by
// which. Who streams goes on. When the client connects anew it reads its files again.
TEST_F(SdkSecurity, ItFollowsRenewedFilesOnBothSides) {
  StartDaemon();
  std::ofstream(In("trusted.pem")) << TextOf(In("lab.pem"));
  test::Heard<Connection> connections;
  ClientOptions options = With(Token("editor", "trusted.pem"));
  options.follow_volume = true;
  options.callbacks.on_connection = connections.Callback();
  const Client client(options);
  ASSERT_TRUE(client.WaitUntilConnected(60s)) << client.connection().why;
  ASSERT_TRUE(Eventually([&] { return client.NewestPose().has_value(); }));

  Issue("other", "renewed", "DNS:localhost", 10, "serverAuth");
  std::filesystem::rename(In("renewed.key"), In("server.key"));
  std::filesystem::rename(In("renewed.pem"), In("server.pem"));
  daemon_->process().Signal(SIGHUP);
  const Client newcomer(With(Token("editor", "other.pem")));
  ASSERT_TRUE(newcomer.WaitUntilConnected(60s)) << newcomer.connection().why;
  EXPECT_EQ(client.connection().state, ConnectionState::kConnected);
  const auto tick = client.NewestPose()->tick;
  ASSERT_TRUE(Eventually([&] { return client.NewestPose()->tick > tick + 100; }));

  std::ofstream(In("trusted.pem"), std::ios::app) << TextOf(In("other.pem"));
  RevokeToken("editor");
  ASSERT_TRUE(IsToldThatItWasRevoked(client));
  // Connecting is not said anew, nor the same reason.
  EXPECT_LE(connections.all().size(), 4u);
  AddToken("editor", "editor");
  ASSERT_TRUE(client.WaitUntilConnected(60s)) << client.connection().why;
  const auto again = client.NewestPose()->tick;
  ASSERT_TRUE(Eventually([&] { return client.NewestPose()->tick > again + 100; }));
  const std::string log = daemon_->End().error;
  EXPECT_TRUE(Has(log, "PoseService/StreamPoses of token editor"));
  EXPECT_TRUE(Has(log, "VolumeService/StreamVolume of token editor"));
}

class SdkSecurityTimes : public SdkSecurity {};

// Its connection succeeds at every attempt, and yet the pauses grow.
TEST_F(SdkSecurityTimes, ARevokedClientDoesNotHammer) {
  const test::StolenShare stolen;
  StartDaemon();
  const auto begin = std::chrono::steady_clock::now();
  const Client client(With(Token("editor")));
  ASSERT_TRUE(client.WaitUntilConnected(60s)) << client.connection().why;
  RevokeToken("editor");
  ASSERT_TRUE(IsToldThatItWasRevoked(client));
  std::this_thread::sleep_for(10s);
  const std::string log = daemon_->End().error;
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  int refused = 0;
  for (auto at = log.find("refused a stranger"); at != log.npos;
       at = log.find("refused a stranger", at + 1)) {
    ++refused;
  }
  std::printf("refused %d times in %.1f s\n", refused, took.count());
  // Pauses of 0.05 s at least, doubled to 2.5 s at least: 7 until then.
  EXPECT_LE(refused, 7 + took.count() / 2.5);
  EXPECT_GE(refused, 3);
}

}  // namespace
}  // namespace palpate::client
