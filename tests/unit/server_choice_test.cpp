// Which palpated a client talks to, by profile, options and environment.
#include "client/sdk/server_choice.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "common/error/error.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate::client {
namespace {

class ServerChoiceTest : public ::testing::Test {
 protected:
  void SetUp() override {
    setenv("XDG_CONFIG_HOME", folder_.path().c_str(), 1);
    for (const char* name : {"PALPATE_SERVER", "PALPATE_TLS_CA", "PALPATE_TOKEN_FILE"}) {
      unsetenv(name);
    }
  }
  void TearDown() override {
    SetUp();
    unsetenv("XDG_CONFIG_HOME");
  }
  void Write(const std::string& text) const {
    std::filesystem::create_directories(Folder());
    std::ofstream(ProfilesFile()) << text;
  }
  std::filesystem::path Folder() const { return folder_.path() / "palpate"; }
  std::string In(const std::string& name) const { return Folder() / name; }
  // Whether it is refused as this, on one line that names `part`.
  static bool Refuses(const ServerChoice& choice, ErrorKind kind, const std::string& part) {
    const auto resolve = [&] { Resolve(choice); };
    const std::string what = testing::Complaint(resolve);
    return testing::Refusal(resolve) == kind && what.find('\n') == what.npos &&
           what.find(part) != what.npos;
  }

  const test::TemporaryFolder folder_;
};

TEST_F(ServerChoiceTest, AProfileIsWholeAndRelativeToItsFile) {
  Write(
      "[or-2]\nserver = \"or-2:7411\"\ntls_ca = \"or-2-ca.pem\"\ntoken_file = \"/t/or-2\"\n"
      "[\"bench.1\"]\nsocket = \"palpated.sock\"\n");
  setenv("PALPATE_TOKEN_FILE", "/other", 1);
  setenv("PALPATE_SERVER", "other:1", 1);
  const Server server = Resolve({.profile = "or-2"});
  EXPECT_EQ(server.address.host_port, "or-2:7411");
  EXPECT_EQ(server.credentials.ca_file, In("or-2-ca.pem"));
  EXPECT_EQ(server.credentials.token_file, "/t/or-2");
  EXPECT_EQ(server.credentials.key_file, "");
  EXPECT_EQ(Resolve({.profile = "bench.1"}).address.socket_path, In("palpated.sock"));
  EXPECT_EQ(Resolve({.profile = "bench.1"}).address.host_port, "");
}

TEST_F(ServerChoiceTest, WhatIsWrongWithAProfileIsSaid) {
  constexpr ErrorKind kInvalid = ErrorKind::kInvalidArgument;
  EXPECT_TRUE(Refuses({.profile = "a"}, ErrorKind::kNotFound, ProfilesFile()));
  Write("[a]\nserver = \"a:1\"\nsocket = \"b\"\n[b]\nsocke = \"b\"\n[c]\nserver = 1\n[d]\n");
  EXPECT_TRUE(Refuses({.profile = "x"}, ErrorKind::kNotFound, "a, b, c, d"));
  for (const std::string name : {"a", "b", "c", "d"}) {
    EXPECT_TRUE(Refuses({.profile = name}, kInvalid, "profile " + name)) << name;
  }
  EXPECT_TRUE(Refuses({.profile = "b"}, kInvalid, "socke"));
  EXPECT_TRUE(Refuses({.profile = "a", .address = {.host_port = "a:1"}}, kInvalid, ""));
  Write("[a\n");
  EXPECT_TRUE(Refuses({.profile = "a"}, kInvalid, "clients.toml:"));
}

TEST_F(ServerChoiceTest, TheEnvironmentFillsWhatIsNotGiven) {
  EXPECT_EQ(Resolve({}).address.host_port, "");
  setenv("PALPATE_SERVER", "or-2:7411", 1);
  setenv("PALPATE_TOKEN_FILE", "/t", 1);
  EXPECT_EQ(Resolve({}).address.host_port, "or-2:7411");
  EXPECT_EQ(Resolve({}).credentials.token_file, "");  // without TLS it is never sent
  setenv("PALPATE_TLS_CA", "/ca", 1);
  EXPECT_EQ(Resolve({}).credentials.ca_file, "/ca");
  EXPECT_EQ(Resolve({}).credentials.token_file, "/t");
  const ServerChoice given{.address = {.host_port = "a:1"},
                           .credentials = {.ca_file = "/a", .token_file = "/b"}};
  EXPECT_EQ(Resolve(given).address.host_port, "a:1");
  EXPECT_EQ(Resolve(given).credentials.ca_file, "/a");
  EXPECT_EQ(Resolve(given).credentials.token_file, "/b");
  // A socket needs none of it.
  EXPECT_EQ(Resolve({.address = {.socket_path = "/s"}}).credentials.ca_file, "");
  EXPECT_EQ(Resolve({.address = {.socket_path = "/s"}}).address.host_port, "");
}

TEST_F(ServerChoiceTest, ProfilesAreListedWithWhatIsWrong) {
  EXPECT_TRUE(ListProfiles().empty());
  Write("[b]\nserver = \"b:1\"\n[a]\nnonsense = 1\n[c]\nsocket = \"/s\"\n");
  const std::vector<Profile> profiles = ListProfiles();
  ASSERT_EQ(profiles.size(), 3u);
  EXPECT_EQ(profiles[0].name, "a");
  EXPECT_EQ(profiles[0].where, "");
  EXPECT_EQ(profiles[1].where, "b:1");
  EXPECT_EQ(profiles[2].where, "/s");
}

}  // namespace
}  // namespace palpate::client
