// The configuration file of palpate-web.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "client/web/app/config.h"
#include "common/error/error.h"
#include "tests/support/temporary_folder.h"

namespace palpate::web {
namespace {

constexpr char kHash[] = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";

class WebConfig : public testing::Test {
 protected:
  std::filesystem::path Write(const std::string& name, const std::string& text) const {
    const std::filesystem::path file = folder_.path() / name;
    std::ofstream(file) << text;
    std::filesystem::permissions(file, std::filesystem::perms(0640));
    return file;
  }
  std::vector<std::string> Read(const std::string& text, Config& config) const {
    return ReadConfig(Write("web.toml", text), config);
  }

  test::TemporaryFolder folder_;
};

TEST_F(WebConfig, ReadsEveryKey) {
  struct Key {
    std::string text;
    std::function<bool(const Config&)> is_read;
  };
  const std::string user = std::string("user = [{name = 'a', token_sha256 = '") + kHash +
                           "', may_steer = ['isovalue', 'facing']}]";
  const Key keys[] = {
      {"palpated.profile = 'or-2'", [](auto& c) { return c.palpated.profile == "or-2"; }},
      {"palpated.socket = '/a/b'",
       [](auto& c) { return c.palpated.address.socket_path == "/a/b"; }},
      {"palpated.server = 'a:7400'",
       [](auto& c) { return c.palpated.address.host_port == "a:7400"; }},
      {"palpated.tls_ca = '/a'", [](auto& c) { return c.palpated.credentials.ca_file == "/a"; }},
      {"palpated.tls_cert = '/a'",
       [](auto& c) { return c.palpated.credentials.certificate_file == "/a"; }},
      {"palpated.tls_key = '/a'", [](auto& c) { return c.palpated.credentials.key_file == "/a"; }},
      {"palpated.token_file = '/a'",
       [](auto& c) { return c.palpated.credentials.token_file == "/a"; }},
      {"web.listen = '[::1]:81'", [](auto& c) { return c.http.listen.ToString() == "[::1]:81"; }},
      {"web.public_url = 'https://a'", [](auto& c) { return c.http.public_url == "https://a"; }},
      {"web.page = '/a'", [](auto& c) { return c.http.page_folder == "/a"; }},
      {"web.certificate = '/a'", [](auto& c) { return c.http.certificate_file == "/a"; }},
      {"web.key = '/a'", [](auto& c) { return c.http.key_file == "/a"; }},
      {"web.behind_proxy = true", [](auto& c) { return c.http.behind_proxy; }},
      {"web.volume = false", [](auto& c) { return !c.with_groups; }},
      {"web.max_guests = 7", [](auto& c) { return c.http.max_guests == 7; }},
      {"room.key_file = '/a'", [](auto& c) { return c.room_key_file == "/a"; }},
      {"metrics.listen = '127.0.0.1:9'", [](auto& c) { return c.metrics->port == 9; }},
      {"nats.publish = 'nats://a'", [](auto& c) { return c.nats.publish == "nats://a"; }},
      {"nats.from = 'nats://a'", [](auto& c) { return c.nats.from == "nats://a"; }},
      {"nats.room = 'hall'", [](auto& c) { return c.nats.options.room == "hall"; }},
      {"nats.user = 'lyon'", [](auto& c) { return c.nats.options.server.user == "lyon"; }},
      {"nats.password_file = '/a'",
       [](auto& c) { return c.nats.options.server.password_file == "/a"; }},
      {"nats.tls_ca = '/a'", [](auto& c) { return c.nats.options.server.ca_file == "/a"; }},
      {"nats.tls_cert = '/a'",
       [](auto& c) { return c.nats.options.server.certificate_file == "/a"; }},
      {"nats.tls_key = '/a'", [](auto& c) { return c.nats.options.server.key_file == "/a"; }},
      {"site = [{name = 'lyon', may_steer = ['isovalue']}]",
       [](auto& c) {
         return c.nats.options.sites.size() == 1 && c.nats.options.sites[0].name == "lyon" &&
                c.nats.options.sites[0].may_steer == std::vector<std::string>{"isovalue"};
       }},
      {user, [](auto& c) { return c.users.size() == 1 && c.users[0].may_steer.size() == 2; }},
  };
  for (const Key& key : keys) {
    Config config;
    EXPECT_EQ(Read(key.text, config), std::vector<std::string>{});
    EXPECT_TRUE(key.is_read(config)) << key.text;
  }
}

TEST_F(WebConfig, FaultsNameFileLineAndKey) {
  const struct {
    std::string text, key;
  } faults[] = {
      {"web.listn = 'a:1'", "web.listn"},
      {"[webb]\na = 1", "webb"},
      {"web = 1", "web"},
      {"web.listen = 7480", "web.listen"},
      {"web.listen = 'a:0'", "web.listen"},
      {"web.page = 'relative'", "web.page"},
      {"web.volume = 1", "web.volume"},
      {"web.max_guests = 0", "web.max_guests"},
      {"web.max_guests = 1.0", "web.max_guests"},
      {"web.max_guests = 961", "web.max_guests"},
      {"room.key_file = ''", "room.key_file"},
      {"user = 'a'", "user"},
      {"[user]\nname = 'a'", "user"},
      {std::string("user = [{name = 'a b', token_sha256 = '") + kHash + "'}]", "name"},
      {"user = [{name = 'a', token_sha256 = '12'}]", "token_sha256"},
      {"user = [{name = 'a'}]", "token_sha256"},
      {std::string("user = [{token_sha256 = '") + kHash + "'}]", "name"},
      {std::string("user = [{name = 'a', may_steer = ['force'], token_sha256 = '") + kHash + "'}]",
       "may_steer"},
      {std::string("user = [{name = 'a', role = 'x', token_sha256 = '") + kHash + "'}]", "role"},
      {"nats.server = 'nats://a'", "nats.server"},
      {"nats.password = 'secret'", "nats.password"},
      {"nats.user = 'a.b'", "nats.user"},
      {"nats.password_file = 'relative'", "nats.password_file"},
      {"[site]\nname = 'a'", "site"},
      {"site = [{name = 'a'}]", "may_steer"},
      {"site = [{may_steer = ['isovalue']}]", "name"},
      {"site = [{name = 'a.b', may_steer = ['isovalue']}]", "name"},
      {"site = [{name = 'a', may_steer = ['force']}]", "may_steer"},
      {"web.listen = ", ""},
  };
  for (const auto& [text, key] : faults) {
    Config config;
    const std::vector<std::string> found = Read("\n\n" + text, config);
    ASSERT_EQ(found.size(), 1u) << text;
    const std::string begin = (folder_.path() / "web.toml").string() + ":";
    EXPECT_TRUE(found[0].starts_with(begin + "3") || found[0].starts_with(begin + "4")) << found[0];
    EXPECT_NE(found[0].find(key), std::string::npos) << found[0];
  }
  Config config;
  EXPECT_EQ(Read("a = 1\nb = 2\nweb.c = 3", config).size(), 3u) << "all faults at once";
  EXPECT_EQ(ReadConfig(folder_.path() / "missing.toml", config).size(), 1u);
}

TEST_F(WebConfig, FilesThatOthersMayWriteAreRefused) {
  Config config;
  EXPECT_EQ(Read("web.volume = true", config), std::vector<std::string>{});
  for (const unsigned mode : {0660u, 0606u}) {
    const auto key = Write("key", std::string(32, 'k') + "\n");
    EXPECT_EQ(ReadRoomKey(key), std::string(32, 'k'));
    std::filesystem::permissions(key, std::filesystem::perms(mode));
    std::filesystem::permissions(folder_.path() / "web.toml", std::filesystem::perms(mode));
    EXPECT_EQ(ReadConfig(folder_.path() / "web.toml", config).size(), 1u);
    EXPECT_THROW(ReadRoomKey(key), Error);
    config.http.certificate_file = config.http.key_file = key;
    EXPECT_EQ(CheckConfig(config).size(), 1u);
    config.http = {};
    std::filesystem::permissions(folder_.path() / "web.toml", std::filesystem::perms(0640));
  }
}

TEST_F(WebConfig, RoomKeysAreLongEnough) {
  EXPECT_THROW(ReadRoomKey(Write("key", "short\n")), Error);
  EXPECT_THROW(ReadRoomKey(Write("key", "")), Error);
  EXPECT_THROW(ReadRoomKey(folder_.path() / "missing"), Error);
}

TEST_F(WebConfig, RoomKeysAreNotForAllAccounts) {
  const auto key = Write("key", std::string(32, 'k'));
  std::filesystem::permissions(key, std::filesystem::perms(0644));
  EXPECT_THROW(ReadRoomKey(key), Error);
}

TEST_F(WebConfig, WhatCannotStartIsAFault) {
  const std::filesystem::path missing = folder_.path() / "missing";
  const auto file = Write("a.pem", "");
  const std::function<void(Config&)> faults[] = {
      [&](Config& c) { c.http.certificate_file = missing, c.http.key_file = file; },
      [&](Config& c) { c.http.certificate_file = file, c.http.key_file = missing; },
      [&](Config& c) { c.http.page_folder = missing; },
      [&](Config& c) { c.http.page_folder = folder_.path(); },
      [](Config& c) {
        c.users = {{"a", kHash, {}}, {"b", kHash, {}}};
      },
      [](Config& c) {
        c.http.listen.host = "palpate.example.org";
        c.http.public_url = "https://palpate.example.org";
        c.http.behind_proxy = true;
      },
  };
  for (const auto& fault : faults) {
    Config config;
    fault(config);
    EXPECT_EQ(CheckConfig(config).size(), 1u) << &fault - faults;
  }
  Config config;
  Write("index.html", "");
  config.http.page_folder = folder_.path();
  config.http.certificate_file = config.http.key_file = file;
  EXPECT_EQ(CheckConfig(config), std::vector<std::string>{});
}

TEST_F(WebConfig, OtherAddressesThanLoopbackNeedTlsOrAProxy) {
  Config config;
  EXPECT_EQ(CheckConfig(config).size(), 0u);
  for (const char* const host : {"0.0.0.0", "192.168.1.2", "::"}) {
    config = {};
    config.http.listen.host = host;
    config.http.public_url = "https://palpate.example.org";
    EXPECT_EQ(CheckConfig(config).size(), 1u) << host;
    config.http.behind_proxy = true;
    EXPECT_EQ(CheckConfig(config).size(), 0u) << host;
    config.http.behind_proxy = false;
    config.http.certificate_file = config.http.key_file = Write("a.pem", "");
    EXPECT_EQ(CheckConfig(config).size(), 0u) << host;
    config.http.key_file.clear();
    EXPECT_EQ(CheckConfig(config).size(), 1u) << "a certificate without its key";
    config.http.public_url.clear();
    config.http.certificate_file.clear();
    config.http.behind_proxy = true;
    EXPECT_EQ(CheckConfig(config).size(), 1u) << "no public URL";
  }
  config = {};
  config.metrics = HostPort{"0.0.0.0", 9481};
  EXPECT_EQ(CheckConfig(config).size(), 1u) << "metrics are for loopback alone";
}

TEST_F(WebConfig, ARoomIsPublishedOrServed) {
  const auto password = Write("password", "secret\n");
  Config good;
  good.nats.publish = "nats://127.0.0.1:4222";
  good.nats.options.room = "hall-1";
  good.nats.options.server.user = "or-2";
  good.nats.options.server.password_file = password;
  good.nats.options.sites = {{"lyon", {"isovalue"}}};
  EXPECT_EQ(CheckConfig(good), std::vector<std::string>{});
  const std::function<void(Config&)> faults[] = {
      [](Config& c) { c.nats.publish.clear(), c.nats.options.sites.clear(); },
      [](Config& c) {
        c.nats.publish.clear(), c.nats.options.sites.clear(), c.nats.options.room.clear();
      },
      [](Config& c) { c.nats.options.sites.push_back(c.nats.options.sites[0]); },
      [](Config& c) { c.nats.from = c.nats.publish; },
      [](Config& c) { c.nats.from.swap(c.nats.publish); },  // with a site
      [](Config& c) { c.nats.options.room.clear(); },
      [](Config& c) { c.nats.options.room = "Hall 1"; },
      [](Config& c) { c.nats.options.server.password_file.clear(); },
      [](Config& c) {
        c.nats.options.server.certificate_file = c.nats.options.server.password_file;
      },
      [&](Config& c) { c.nats.options.server.ca_file = folder_.path() / "missing"; },
      [](Config& c) {
        c.nats.from.swap(c.nats.publish);
        c.nats.options.sites.clear();
        c.with_groups = false;
      },
      [](Config& c) {
        c.nats.from.swap(c.nats.publish);
        c.nats.options.sites.clear();
        c.nats.options.server.user.clear(), c.nats.options.server.password_file.clear();
        c.users = {{"ada", kHash, {"isovalue"}}};
      },
  };
  for (const auto& fault : faults) {
    Config config = good;
    fault(config);
    EXPECT_EQ(CheckConfig(config).size(), 1u) << &fault - faults;
  }
}

TEST_F(WebConfig, OnlyThisMachinesNatsServerIsUsedWithoutTls) {
  const auto faults = [this](const std::string& url, bool has_ca = false) {
    Config config;
    config.nats.from = url;
    config.nats.options.room = "hall";
    if (has_ca) config.nats.options.server.ca_file = Write("ca.pem", "");
    return CheckConfig(config);
  };
  for (const char* const url : {"nats://127.0.0.1:1", "nats://localhost", "nats://[::1]:4222",
                                "tls://nats.example.org", "tls://10.0.0.1:4222"}) {
    EXPECT_EQ(faults(url), std::vector<std::string>{}) << url;
  }
  EXPECT_EQ(faults("nats://10.0.0.1:4222", true), std::vector<std::string>{});
  for (const char* const url :
       {"nats://10.0.0.1:4222", "nats://nats.example.org", "nats://127.0.0.1.example.org:1",
        "http://127.0.0.1:4222", "127.0.0.1:4222", "ws://127.0.0.1:4222", "nats://", "tls://:1",
        "nats://127.0.0.1:4222/x", "nats://127.0.0.1:1,nats://10.0.0.1:1"}) {
    EXPECT_EQ(faults(url).size(), 1u) << url;
  }
}

TEST_F(WebConfig, SecretsOfNatsStandInFilesThatOthersDoNotRead) {
  for (const char* const url : {"nats://user:secret@127.0.0.1:1", "tls://secret@nats.example.org",
                                "natss://user:secret@127.0.0.1:1", "user:secret@127.0.0.1"}) {
    Config config;
    config.nats.from = url;
    config.nats.options.room = "hall";
    const std::vector<std::string> found = CheckConfig(config);
    ASSERT_EQ(found.size(), 1u) << url;
    EXPECT_NE(found[0].find("nats.password_file"), std::string::npos) << found[0];
    EXPECT_EQ(found[0].find("secret"), std::string::npos) << "the log keeps what is said";
  }
  Config config;
  config.nats.from = "nats://127.0.0.1:1";
  config.nats.options.room = "hall";
  config.nats.options.server.user = "lyon";
  config.nats.options.server.password_file = Write("password", "# For lyon alone: secret");
  EXPECT_EQ(CheckConfig(config).size(), 1u) << "the whole line of nats-user";
  for (auto* const file :
       {&config.nats.options.server.password_file, &config.nats.options.server.key_file}) {
    config.nats.options.server.password_file = Write("password", "secret");
    config.nats.options.server.certificate_file = Write("cert", "");
    config.nats.options.server.key_file = Write("key", "");
    EXPECT_EQ(CheckConfig(config), std::vector<std::string>{});
    for (const unsigned mode : {0644u, 0660u, 0602u}) {
      std::filesystem::permissions(*file, std::filesystem::perms(mode));
      EXPECT_EQ(CheckConfig(config).size(), 1u) << *file << std::oct << mode;
    }
  }
}

}  // namespace
}  // namespace palpate::web
