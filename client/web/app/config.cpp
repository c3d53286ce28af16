#include "client/web/app/config.h"

#include <sys/stat.h>
#include <toml++/toml.h>

#include <boost/asio/ip/address.hpp>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <system_error>

#include "client/web/http/origins.h"
#include "client/web/logins/steering_rules.h"
#include "client/web/room/room_protocol.h"
#include "common/error/error.h"
#include "common/error/text.h"

namespace palpate::web {
namespace {

namespace fs = std::filesystem;

// Why the file cannot be trusted: others may write it. Empty: it can, or there is none.
std::string WriteFault(const fs::path& file) {
  struct stat info {};
  if (file.empty() || stat(file.c_str(), &info) != 0) return "";
  if ((info.st_mode & (S_IWGRP | S_IWOTH)) == 0) return "";
  return file.string() + ": others may write this file: chmod go-w " + file.string();
}

// `key` is that of the configuration, for the error. Errors: kNotFound, kPermissionDenied,
// kInvalidArgument (others may write the file, or all accounts may read it).
void CheckSecretFile(const std::string& key, const fs::path& file) {
  if (const std::string fault = WriteFault(file); !fault.empty()) Refuse(fault);
  struct stat info {};
  if (stat(file.c_str(), &info) == 0 && (info.st_mode & S_IROTH) != 0) {
    Refuse(key + ": all accounts may read this file: chmod o-r " + file.string());
  }
  if (std::ifstream(file)) return;
  std::error_code error;
  const bool exists = fs::exists(file, error);
  throw Error(exists ? ErrorKind::kPermissionDenied : ErrorKind::kNotFound,
              key + ": cannot read " + file.string());
}

void CheckUse(const NatsConfig& nats) {
  if (!nats.publish.empty() && !nats.from.empty()) {
    Refuse("nats.publish and nats.from: a gateway publishes a room or serves one, not both");
  }
  if (!nats.url().empty() && !IsRoom(nats.options.room)) {
    Refuse("nats.room: name the room by 1 to 32 of a-z, 0-9, '_' and '-'");
  }
  const NatsServer& server = nats.options.server;
  if (nats.url().empty() &&
      !(nats.options.room.empty() && server.user.empty() && server.password_file.empty() &&
        server.ca_file.empty() && server.certificate_file.empty() && server.key_file.empty())) {
    Refuse("nats: give nats.publish or nats.from, or remove what stands there");
  }
  if (nats.publish.empty() && !nats.options.sites.empty()) {
    Refuse("site: belongs to the configuration of the gateway that publishes the room");
  }
  std::set<std::string> names;
  for (const RemoteSite& site : nats.options.sites) {
    if (!names.insert(site.name).second) Refuse("site: " + site.name + " stands there twice");
  }
}

// Calls `attempt` with each check, which throws what is wrong. Plain text goes to loopback alone,
// and nobody else may read the password. Looks for the files that are named.
void CheckNats(const NatsConfig& nats,
               const std::function<void(const std::function<void()>& check)>& attempt) {
  NatsServer server = nats.options.server;
  server.url = nats.url();
  attempt([&] { CheckUse(nats); });
  if (!server.url.empty()) attempt([&] { Check(server); });
  if (!server.password_file.empty()) {
    attempt([&] { CheckSecretFile("nats.password_file", server.password_file); });
  }
  if (!server.key_file.empty()) {
    attempt([&] { CheckSecretFile("nats.tls_key", server.key_file); });
  }
}

// Its publisher knows this gateway by its NATS user.
void CheckSteering(const Config& config) {
  if (config.nats.from.empty() || !config.nats.options.server.user.empty()) return;
  for (const User& user : config.users) {
    if (!user.may_steer.empty()) Refuse("user: " + user.name + " cannot steer without nats.user");
  }
}

void CheckListen(const HttpOptions& http) {
  boost::system::error_code problem;
  boost::asio::ip::make_address(http.listen.host, problem);
  if (problem && http.listen.host != "localhost") {
    Refuse("web.listen: " + http.listen.host + " is no IP address: give one, or localhost");
  }
}

void CheckReadable(const std::string& key, const fs::path& file) {
  if (!file.empty() && !std::ifstream(file)) {
    Refuse(key + ": cannot read " + file.string());
  }
}

void CheckPage(const fs::path& folder) {
  std::error_code error;
  if (!folder.empty() && !fs::exists(folder / "index.html", error)) {
    Refuse("web.page: " + folder.string() + " has no index.html");
  }
}

}  // namespace

std::vector<std::string> CheckConfig(const Config& config) {
  std::vector<std::string> faults;
  const auto attempt = [&](const std::function<void()>& check) {
    try {
      check();
    } catch (const Error& error) {
      faults.emplace_back(error.what());
    }
  };
  const HttpOptions& http = config.http;
  if (config.nats.from.empty()) attempt([&] { client::Resolve(config.palpated); });
  if (!config.room_key_file.empty()) attempt([&] { ReadRoomKey(config.room_key_file); });
  attempt([&] { Access({.room_key = NewSecret(128), .users = config.users}); });
  if (const std::string fault = WriteFault(http.key_file); !fault.empty()) faults.push_back(fault);
  attempt([&] { Origins(http, http.listen.port); });
  attempt([&] { CheckListen(http); });
  attempt([&] { CheckReadable("web.certificate", http.certificate_file); });
  attempt([&] { CheckReadable("web.key", http.key_file); });
  attempt([&] { CheckPage(http.page_folder); });
  if (http.certificate_file.empty() != http.key_file.empty()) {
    faults.emplace_back("web.certificate and web.key go together");
  }
  if (config.metrics && config.metrics->host != "localhost" && !IsLoopback(*config.metrics)) {
    faults.emplace_back(
        "metrics.listen: must be loopback (127.0.0.1, ::1): metrics are neither "
        "encrypted nor authorised");
  }
  attempt([&] { CheckSteering(config); });
  CheckNats(config.nats, attempt);
  if (!config.nats.from.empty() && !config.with_groups) {
    faults.emplace_back(
        "web.volume: guests of a room see what its publisher gives: set web.volume = false there");
  }
  return faults;
}

void CheckSettingKey(const std::string& key) {
  if (IsSetting(key)) return;
  Refuse(key + " is no setting: see the keys of palpate settings --json, and 'facing'");
}

std::string ReadRoomKey(const fs::path& file) {
  CheckSecretFile("room.key_file", file);
  std::ifstream stream(file);
  std::string key;
  stream >> key;
  if (key.size() < Access::kMinRoomKeyLength) {
    Refuse("room.key_file: " + file.string() + " needs a key of at least " +
           std::to_string(Access::kMinRoomKeyLength) + " characters: openssl rand -hex 16");
  }
  return key;
}

fs::path DefaultPageFolder() {
  std::error_code error;
  const fs::path folder = fs::read_symlink("/proc/self/exe", error).parent_path().parent_path();
  const fs::path of_build = folder / "web";
  return fs::exists(of_build / "index.html", error) ? of_build : folder / "share/palpate/web";
}

namespace {

using Setter = std::function<void(const toml::node&)>;
using Setters = std::map<std::string, Setter, std::less<>>;

std::string Text(const toml::node& node) {
  const auto value = node.value_exact<std::string>();
  if (!value || value->empty()) Refuse("must be a text in quotes");
  return *value;
}

bool Flag(const toml::node& node) {
  if (const auto value = node.value_exact<bool>()) return *value;
  Refuse("must be true or false");
}

int Integer(const toml::node& node, int least, int most) {
  const auto value = node.value_exact<std::int64_t>();
  if (value && *value >= least && *value <= most) return static_cast<int>(*value);
  Refuse("must be a whole number from " + std::to_string(least) + " to " + std::to_string(most));
}

fs::path File(const toml::node& node) {
  const fs::path path = Text(node);
  if (!path.is_absolute()) Refuse("must be an absolute path");
  return path;
}

std::vector<std::string> SettingKeys(const toml::node& node) {
  const toml::array* const array = node.as_array();
  if (!array) Refuse("must be a list of settings, [\"isovalue\"]");
  std::vector<std::string> keys;
  for (const toml::node& one : *array) {
    keys.push_back(Text(one));
    CheckSettingKey(keys.back());
  }
  return keys;
}

std::string UserName(const toml::node& node) {
  const std::string name = Text(node);
  if (!client::IsProfileName(name)) Refuse("must be 1 to 64 letters, digits, '.', '_' or '-'");
  return name;
}

std::string TokenHash(const toml::node& node) {
  const std::string hex = Text(node);
  if (!DigestFromHex(hex)) Refuse("must be 64 hex digits, as 'palpate-web user NAME' prints them");
  return hex;
}

std::string Site(const toml::node& node) {
  const std::string name = Text(node);
  if (!IsNatsUser(name)) Refuse("must be 1 to 64 letters, digits, '_' or '-'");
  return name;
}

Setters SettersOf(Config& c) {
  client::Address& address = c.palpated.address;
  client::Credentials& who = c.palpated.credentials;
  NatsServer& nats = c.nats.options.server;
  const int most_guests = c.http.max_connections - c.http.max_strangers;
  return {
      {"palpated.profile", [&](auto& n) { c.palpated.profile = Text(n); }},
      {"palpated.socket", [&](auto& n) { address.socket_path = File(n); }},
      {"palpated.server", [&](auto& n) { address.host_port = ParseHostPort(Text(n)).ToString(); }},
      {"palpated.tls_ca", [&](auto& n) { who.ca_file = File(n); }},
      {"palpated.tls_cert", [&](auto& n) { who.certificate_file = File(n); }},
      {"palpated.tls_key", [&](auto& n) { who.key_file = File(n); }},
      {"palpated.token_file", [&](auto& n) { who.token_file = File(n); }},
      {"web.listen", [&](auto& n) { c.http.listen = ParseHostPort(Text(n)); }},
      {"web.public_url", [&](auto& n) { c.http.public_url = Text(n); }},
      {"web.page", [&](auto& n) { c.http.page_folder = File(n); }},
      {"web.certificate", [&](auto& n) { c.http.certificate_file = File(n); }},
      {"web.key", [&](auto& n) { c.http.key_file = File(n); }},
      {"web.behind_proxy", [&](auto& n) { c.http.behind_proxy = Flag(n); }},
      {"web.volume", [&](auto& n) { c.with_groups = Flag(n); }},
      {"web.max_guests",
       [&c, most_guests](auto& n) { c.http.max_guests = Integer(n, 1, most_guests); }},
      {"room.key_file", [&](auto& n) { c.room_key_file = File(n); }},
      {"metrics.listen", [&](auto& n) { c.metrics = ParseHostPort(Text(n)); }},
      {"nats.publish", [&](auto& n) { c.nats.publish = Text(n); }},
      {"nats.from", [&](auto& n) { c.nats.from = Text(n); }},
      {"nats.room", [&](auto& n) { c.nats.options.room = Text(n); }},
      {"nats.user", [&](auto& n) { nats.user = Site(n); }},
      {"nats.password_file", [&](auto& n) { nats.password_file = File(n); }},
      {"nats.tls_ca", [&](auto& n) { nats.ca_file = File(n); }},
      {"nats.tls_cert", [&](auto& n) { nats.certificate_file = File(n); }},
      {"nats.tls_key", [&](auto& n) { nats.key_file = File(n); }},
  };
}

Setters UserSetters(User& user) {
  return {{"name", [&](auto& n) { user.name = UserName(n); }},
          {"token_sha256", [&](auto& n) { user.token_sha256_hex = TokenHash(n); }},
          {"may_steer", [&](auto& n) { user.may_steer = SettingKeys(n); }}};
}

Setters SiteSetters(RemoteSite& site) {
  return {{"name", [&](auto& n) { site.name = Site(n); }},
          {"may_steer", [&](auto& n) { site.may_steer = SettingKeys(n); }}};
}

class Reader {
 public:
  Reader(const fs::path& file, Config& config) : file_(file), config_(config) {}

  std::vector<std::string> Read() {
    try {
      ReadTables(toml::parse_file(file_.string()));
    } catch (const toml::parse_error& error) {
      Add(error.source().begin.line, OneLine(error.description()));
    }
    return std::move(faults_);
  }

 private:
  // Line 0: of the whole file.
  void Add(std::size_t line, const std::string& what) {
    faults_.push_back(file_.string() + (line > 0 ? ":" + std::to_string(line) : "") + ": " + what);
  }

  void ReadTables(const toml::table& file) {
    const Setters setters = SettersOf(config_);
    for (const auto& [name, node] : file) {
      const std::string key(name.str());
      const auto with_prefix = setters.lower_bound(key + ".");
      const bool is_table =
          with_prefix != setters.end() && with_prefix->first.starts_with(key + ".");
      if (key == "user") {
        ReadEach("user", node, UserSetters, {"name", "token_sha256"}, config_.users);
      } else if (key == "site") {
        ReadEach("site", node, SiteSetters, {"name", "may_steer"}, config_.nats.options.sites);
      } else if (is_table && node.is_table()) {
        ReadTable(*node.as_table(), key + ".", setters);
      } else {
        Add(node.source().begin.line,
            key + (is_table ? " must be a table, [" + key + "]"
                            : " is no table of palpate-web: there are palpated, web, room, user, "
                              "metrics, nats and site"));
      }
    }
  }

  void ReadTable(const toml::table& table, const std::string& prefix, const Setters& setters) {
    for (const auto& [name, node] : table) {
      const std::string key = prefix + std::string(name.str());
      try {
        const auto setter = setters.find(key);
        if (setter == setters.end()) Refuse("is no key of palpate-web");
        setter->second(node);
      } catch (const Error& error) {
        Add(node.source().begin.line, key + ": " + error.what());
      }
    }
  }

  // Each table of [[name]], which has the needed keys.
  template <typename Item>
  void ReadEach(const std::string& name, const toml::node& node, Setters (*setters)(Item&),
                const std::vector<std::string>& needed, std::vector<Item>& items) {
    const toml::array* const array = node.as_array();
    if (!array || !array->is_array_of_tables()) {
      Add(node.source().begin.line, name + " must be tables, [[" + name + "]]");
      return;
    }
    for (const toml::node& one : *array) {
      const toml::table& table = *one.as_table();
      Item item;
      ReadTable(table, "", setters(item));
      for (const std::string& key : needed) {
        if (!table.contains(key)) Add(table.source().begin.line, name + " needs " + key);
      }
      items.push_back(std::move(item));
    }
  }

  const fs::path& file_;
  Config& config_;
  std::vector<std::string> faults_;
};

}  // namespace

std::vector<std::string> ReadConfig(const fs::path& file, Config& config) {
  std::vector<std::string> faults = Reader(file, config).Read();
  if (const std::string fault = WriteFault(file); !fault.empty()) faults.push_back(fault);
  return faults;
}

}  // namespace palpate::web
