// The daemon's own pair, clients' certificates, and who a policy recognises by them.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>

#include "common/error/error.h"
#include "server/security/policy.h"
#include "server/security/token.h"
#include "tests/support/certificates.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

// A little later than the certificates that the tests make.
const auto kNow = std::chrono::system_clock::now() + std::chrono::minutes(1);
constexpr std::chrono::hours kDay{24};

ClientAuthority::Chain Shared(std::string pem) {
  return std::make_shared<const std::string>(std::move(pem));
}

class CertificatesTest : public ::testing::Test, protected test::Certificates {
 protected:
  void SetUp() override {
    MakeAuthority("lab");
    Issue("lab", "server", "DNS:localhost");
  }

  // A refusal names one of the two files.
  bool IsTaken(const std::string& certificate, const std::string& key,
               CertificateTime now = kNow) const {
    const std::string line = testing::Complaint([&] { CheckPair(In(certificate), In(key), now); });
    EXPECT_TRUE(line.empty() || line.find(In(certificate)) != line.npos ||
                line.find(In(key)) != line.npos)
        << line;
    return line.empty();
  }
};

TEST_F(CertificatesTest, APairIsTakenWhole) {
  const CheckedPair pair = CheckPair(In("server.pem"), In("server.key"), kNow);
  EXPECT_EQ(pair.pem, Read("server.key") + Read("server.pem"));
  EXPECT_NE(pair.subject.find("server"), std::string::npos);
  EXPECT_GT(pair.valid_until, kNow + 9 * kDay);
  EXPECT_LT(pair.valid_until, kNow + 11 * kDay);
}

// gRPC takes what comes first in it.
TEST_F(CertificatesTest, WhatElseIsInTheFilesIsLeftOut) {
  Issue("lab", "old", "DNS:localhost");
  std::ofstream(In("mixed.key")) << Read("old.pem") << "by hand\n" << Read("server.key");
  std::ofstream(In("mixed.pem")) << "Certificate:\n" << Read("server.pem") << Read("lab.pem");
  chmod(In("mixed.key").c_str(), 0600);
  EXPECT_EQ(CheckPair(In("mixed.pem"), In("mixed.key"), kNow).pem,
            Read("server.key") + Read("server.pem") + Read("lab.pem"));
}

TEST_F(CertificatesTest, APairThatTlsWouldNotTakeIsRefused) {
  ASSERT_TRUE(IsTaken("server.pem", "server.key"));
  EXPECT_FALSE(IsTaken("server.pem", "server.key", kNow + 11 * kDay));
  EXPECT_FALSE(IsTaken("server.pem", "server.key", kNow - kDay));
  Issue("lab", "other", "DNS:localhost");
  Issue("lab", "viewer", "DNS:localhost", 10, "clientAuth");
  Openssl("req -x509 -newkey rsa:1024 -nodes -days 30 -keyout weak.key -out weak.pem -subj /CN=w");
  Openssl("ec -aes256 -passout pass:x -in server.key -out locked.key");
  std::vector<std::pair<std::string, std::string>> bad = {
      {"server.pem", "other.key"},  {"viewer.pem", "viewer.key"}, {"weak.pem", "weak.key"},
      {"server.key", "server.key"}, {"absent.pem", "server.key"}, {"server.pem", "absent.key"},
      {"server.pem", "locked.key"}};
  // Cut short, as while it is being copied.
  const std::string key = Read("server.key");
  for (std::size_t length : {std::size_t{0}, std::size_t{1}, key.size() / 2, key.size() - 30}) {
    bad.push_back({"server.pem", std::to_string(length) + ".key"});
    std::ofstream(In(bad.back().second)) << key.substr(0, length);
  }
  for (const auto& [certificate_file, key_file] : bad) {
    chmod(In(key_file).c_str(), 0600);
    EXPECT_FALSE(IsTaken(certificate_file, key_file)) << certificate_file << ' ' << key_file;
  }
}

TEST_F(CertificatesTest, AKeyThatOthersReadIsRefused) {
  for (const mode_t mode : {0644u, 0604u, 0620u, 0660u, 0602u}) {
    chmod(In("server.key").c_str(), mode);
    EXPECT_FALSE(IsTaken("server.pem", "server.key")) << mode;
  }
  chmod(In("server.key").c_str(), 0640);
  EXPECT_TRUE(IsTaken("server.pem", "server.key"));
}

TEST_F(CertificatesTest, ClientsAreJudgedByTheirAuthority) {
  const ClientAuthority lab(In("lab.pem"));
  Issue("lab", "good", "DNS:a.example,URI:spiffe://lab/b,email:c@example,IP:10.0.0.1");
  const auto good = lab.Check(Shared(Read("good.pem")), kNow);
  EXPECT_EQ(good.problem, "");
  EXPECT_EQ(good.names, (std::vector<std::string>{"a.example", "spiffe://lab/b", "c@example"}));
  // Known already: all calls share one copy. And expired since.
  const auto again = lab.Check(Shared(Read("good.pem")), kNow);
  EXPECT_EQ(again.problem, "");
  EXPECT_EQ(again.chain, good.chain);
  EXPECT_NE(lab.Check(Shared(Read("good.pem")), kNow + 11 * kDay).problem.find("expired"),
            std::string::npos);
  EXPECT_EQ(lab.Check(Shared(Read("good.pem")), kNow).problem, "");

  MakeAuthority("other");
  Issue("other", "fake", "DNS:a.example");
  EXPECT_NE(lab.Check(Shared(Read("fake.pem")), kNow).problem, "");
  // Its own authority along with it proves nothing.
  EXPECT_NE(lab.Check(Shared(Read("fake.pem") + Read("other.pem")), kNow).problem, "");
  EXPECT_NE(lab.Check(Shared(Read("fake.pem") + Read("lab.pem")), kNow).problem, "");
  // A genuine one behind a fake one: the first is the client's.
  EXPECT_NE(lab.Check(Shared(Read("fake.pem") + Read("good.pem")), kNow).problem, "");
  Issue("lab", "web", "DNS:a.example", 10, "serverAuth");
  EXPECT_NE(lab.Check(Shared(Read("web.pem")), kNow).problem.find("purpose"), std::string::npos);
  // A client may not issue for others.
  Issue("good", "child", "DNS:a.example");
  EXPECT_NE(lab.Check(Shared(Read("child.pem") + Read("good.pem")), kNow).problem, "");
  for (const std::string& bad : {std::string(), std::string("-----BEGIN CERTIFICATE-----\n"),
                                 Read("good.pem").substr(0, 200), std::string(100'000, 'A')}) {
    EXPECT_NE(lab.Check(Shared(bad), kNow).problem, "");
  }
  // Good, but each call would keep it all.
  std::string endless = Read("good.pem");
  while (endless.size() <= ClientAuthority::kLongestChain) endless += Read("lab.pem");
  EXPECT_NE(lab.Check(Shared(endless), kNow).problem.find("32 KiB"), std::string::npos);
  EXPECT_THROW(ClientAuthority(In("good.key")), Error);
  EXPECT_THROW(ClientAuthority(In("absent")), Error);
}

TEST_F(CertificatesTest, APolicyKnowsNamesLetterForLetter) {
  const Policy policy({.client_ca = In("lab.pem"),
                       .clients = {{"a.example", Role::kViewer}, {"b.example", Role::kOperator}}});
  const auto recognised = [&](const std::string& san) {
    Issue("lab", "client", san);
    return policy.Recognise(
        {.entry = {Transport::kTls}, .certificate_chain = Shared(Read("client.pem"))}, kNow);
  };
  EXPECT_EQ(recognised("DNS:a.example").identity->role, Role::kViewer);
  EXPECT_EQ(recognised("DNS:a.example,DNS:b.example").identity->name, "certificate b.example");
  for (const char* san : {"", "DNS:A.example", "DNS:x.a.example", "DNS:*.example", "DNS:a.exampl",
                          "DNS:a.example.org", "IP:10.0.0.1"}) {
    EXPECT_FALSE(recognised(san).identity) << san;
    EXPECT_NE(recognised(san).problem, "") << san;
  }
  EXPECT_NE(recognised("DNS:a.example.org").problem.find("a.example.org"), std::string::npos);
}

// What is revoked must not come back because another file is damaged.
TEST_F(CertificatesTest, FilesThatAreReadAgainAreJudgedOneByOne) {
  const std::filesystem::path tokens = In("tokens.toml"), authority = In("clients.pem");
  const NewToken stays = MakeToken("stays", Role::kViewer), goes = MakeToken("goes", Role::kAdmin);
  WriteTokenFile(tokens, {stays.stored, goes.stored});
  std::filesystem::copy_file(In("lab.pem"), authority);
  const PolicyOptions options{
      .client_ca = authority, .clients = {{"localhost", Role::kViewer}}, .tokens = tokens};
  const auto knows = [&](const Policy& policy, const NewToken& token) {
    return policy
        .Recognise({.entry = {Transport::kTls}, .authorization = "Bearer " + token.text}, kNow)
        .identity.has_value();
  };
  const auto knows_certificate = [&](const Policy& policy) {
    return policy
        .Recognise({.entry = {Transport::kTls}, .certificate_chain = Shared(Read("server.pem"))},
                   kNow)
        .identity.has_value();
  };
  const Policy first(options);
  EXPECT_TRUE(knows(first, stays) && knows(first, goes) && knows_certificate(first));

  WriteTokenFile(tokens, {stays.stored});
  std::ofstream(authority) << "";
  std::vector<std::string> problems;
  const Policy revoked(options, first, problems);
  EXPECT_TRUE(knows(revoked, stays) && knows_certificate(revoked));
  EXPECT_FALSE(knows(revoked, goes));
  EXPECT_EQ(problems.size(), 1u);

  std::ofstream(tokens) << "[[token";
  const Policy damaged(options, revoked, problems);
  EXPECT_TRUE(knows(damaged, stays) && !knows(damaged, goes));

  std::filesystem::remove(tokens);
  const Policy without(options, damaged, problems);
  EXPECT_FALSE(knows(without, stays));
  EXPECT_TRUE(knows_certificate(without));
}

TEST_F(CertificatesTest, APolicyTrustsNothingItWasNotTold) {
  const Policy none;
  const std::string chain = Read("server.pem");
  EXPECT_FALSE(none.Recognise({.entry = {Transport::kTls}}, kNow).identity);
  EXPECT_FALSE(
      none.Recognise({.entry = {Transport::kTls}, .certificate_chain = Shared(chain)}, kNow)
          .identity);
  EXPECT_FALSE(
      none.Recognise({.entry = {Transport::kTls}, .authorization = "Bearer "}, kNow).identity);
  // A token without TLS was heard by others; also on the socket.
  for (const Transport plain : {Transport::kPlain, Transport::kSocket}) {
    EXPECT_TRUE(none.Recognise({.entry = {plain}}, kNow).identity);
    EXPECT_FALSE(none.Recognise({.entry = {plain}, .authorization = "Bearer x"}, kNow).identity);
  }
  EXPECT_EQ(none.Recognise({.entry = {Transport::kSocket, Role::kAdmin}}, kNow).identity->role, Role::kAdmin);
  EXPECT_EQ(none.Recognise({.entry = {Transport::kPlain}}, kNow).identity->role, Role::kViewer);
}

}  // namespace
}  // namespace palpate
