// The configuration file: its tables and keys.
#include <toml++/toml.h>

#include <functional>
#include <map>
#include <string_view>

#include "client/web/app/config.h"
#include "client/web/app/secret_file.h"
#include "client/web/room/subjects.h"
#include "common/error/error.h"
#include "common/error/one_line.h"

namespace palpate::web {
namespace {

namespace fs = std::filesystem;

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
