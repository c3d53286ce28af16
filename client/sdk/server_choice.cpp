#include "client/sdk/server_choice.h"

#include <toml++/toml.h>
#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <optional>
#include <sstream>
#include <utility>

#include "common/contract/enumerations.h"
#include "common/error/error.h"
#include "common/wire/address.h"

namespace palpate::client {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kLongestName = 64;
constexpr char kExample[] =
    "[NAME], server = \"HOST:PORT\", tls_ca = \"FILE\", token_file = \"FILE\"";

// Returns the variable if it is set and not empty.
std::string FromEnvironment(const char* variable) {
  const char* value = std::getenv(variable);
  return value ? value : "";
}

// Returns none if the file does not exist.
std::optional<toml::table> ReadProfiles(const fs::path& path) {
  std::ifstream file(path);
  if (!file) {
    std::error_code error;
    if (!fs::exists(path, error)) return std::nullopt;
    throw Error(ErrorKind::kPermissionDenied, "cannot read " + path.string());
  }
  std::ostringstream text;
  text << file.rdbuf();
  try {
    return toml::parse(text.view());
  } catch (const toml::parse_error& error) {
    Refuse(path.string() + ":" + std::to_string(error.source().begin.line) + ": " +
           std::string(error.description()) + "; correct it");
  }
}

std::string Names(const toml::table& profiles) {
  std::string names;
  for (const auto& [name, node] : profiles) {
    names += (names.empty() ? "" : ", ") + std::string(name.str());
  }
  return names.empty() ? "none" : names;
}

// Reads one profile of the file.
class Reading {
 public:
  Reading(const fs::path& file, const std::string& name, const toml::table& table)
      : file_(file), name_(name), table_(table) {}

  Server Read() const {
    CheckKeys();
    Server server;
    server.address.host_port = Text("server");
    server.address.socket_path = Path("socket");
    if (server.address.host_port.empty() == server.address.socket_path.empty()) {
      Fail("give its server = \"HOST:PORT\", or its socket");
    }
    server.credentials = {.ca_file = Path("tls_ca"),
                          .certificate_file = Path("tls_cert"),
                          .key_file = Path("tls_key"),
                          .token_file = Path("token_file")};
    return server;
  }

 private:
  [[noreturn]] void Fail(const std::string& what) const {
    Refuse(file_.string() + ":" + std::to_string(table_.source().begin.line) + ": profile " +
           name_ + ": " + what);
  }
  void CheckKeys() const {
    static constexpr std::string_view kKeys[] = {"server",   "socket",  "tls_ca",
                                                 "tls_cert", "tls_key", "token_file"};
    for (const auto& [key, node] : table_) {
      if (std::ranges::find(kKeys, key.str()) == std::end(kKeys)) {
        Fail(std::string(key.str()) +
             " is no key; there are server, socket, tls_ca, tls_cert, tls_key and token_file");
      }
    }
  }
  std::string Text(std::string_view key) const {
    const toml::node* node = table_.get(key);
    if (!node) return "";
    const auto value = node->value_exact<std::string>();
    if (!value || value->empty()) Fail(std::string(key) + " must be a text in quotes");
    return *value;
  }
  std::string Path(std::string_view key) const {
    const std::string text = Text(key);
    return text.empty() ? "" : (file_.parent_path() / text).lexically_normal().string();
  }

  const fs::path& file_;
  const std::string& name_;
  const toml::table& table_;
};

Server ReadProfile(const std::string& name) {
  const fs::path file = ProfilesFile();
  const auto profiles = ReadProfiles(file);
  if (!profiles) {
    throw Error(ErrorKind::kNotFound, "there is no profile " + name + ": " + file.string() +
                                          " is not there; write it (" + kExample + ")");
  }
  const toml::node* found = profiles->get(name);
  if (!found) {
    throw Error(ErrorKind::kNotFound,
                file.string() + " has no profile " + name + "; it has: " + Names(*profiles));
  }
  if (!IsProfileName(name)) Refuse(name + " is no name for a profile: use letters, digits and ._-");
  const toml::table* table = found->as_table();
  if (!table) Refuse(file.string() + ": " + name + " is no profile: write [" + name + "]");
  return Reading(file, name, *table).Read();
}

bool IsEmpty(const Address& a) {
  return a.socket_path.empty() && a.host_port.empty() && a.role.empty();
}
bool IsEmpty(const Credentials& c) {
  return c.ca_file.empty() && c.certificate_file.empty() && c.key_file.empty() &&
         c.token_file.empty();
}

}  // namespace

Server Resolve(const ServerChoice& choice) {
  if (!choice.profile.empty()) {
    if (!IsEmpty(choice.address) || !IsEmpty(choice.credentials)) {
      Refuse("a profile says where palpated is and who we are: name nothing else with it");
    }
    return ReadProfile(choice.profile);
  }
  Server server{choice.address, choice.credentials};
  if (IsEmpty(server.address)) server.address.host_port = FromEnvironment("PALPATE_SERVER");
  if (server.address.host_port.empty()) return server;
  Credentials& who = server.credentials;
  if (who.ca_file.empty()) who.ca_file = FromEnvironment("PALPATE_TLS_CA");
  // Only with TLS: a token is never sent without it.
  const bool has_tls = !who.ca_file.empty() || !who.certificate_file.empty();
  if (has_tls && who.token_file.empty()) who.token_file = FromEnvironment("PALPATE_TOKEN_FILE");
  return server;
}

std::string SocketPathOf(const Address& address) {
  const std::string usual = address.socket_path.empty() ? DefaultSocketPath() : address.socket_path;
  if (address.role.empty()) return HighestSocketPath(usual);
  if (const auto role = Named<Role>(address.role)) return RoleSocketPath(usual, *role);
  Refuse("'" + address.role + "' is no role: use viewer, editor, operator or admin");
}

fs::path ProfilesFile() {
  fs::path folder = FromEnvironment("XDG_CONFIG_HOME");
  if (!folder.is_absolute()) folder = fs::path(FromEnvironment("HOME")) / ".config";
  return folder / "palpate" / "clients.toml";
}

std::vector<Profile> ListProfiles() {
  const fs::path file = ProfilesFile();
  std::vector<Profile> profiles;
  const auto table = ReadProfiles(file);
  if (!table) return profiles;
  for (const auto& [key, node] : *table) {
    Profile profile{.name = std::string(key.str()), .where = ""};
    try {
      const Server server = ReadProfile(profile.name);
      profile.where =
          server.address.host_port.empty() ? server.address.socket_path : server.address.host_port;
    } catch (const Error&) {
      // `where` stays empty. Resolve tells the reason to those who choose this profile.
    }
    profiles.push_back(std::move(profile));
  }
  return profiles;
}

bool IsProfileName(const std::string& name) {
  const auto is_plain = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
           c == '_' || c == '-';
  };
  return !name.empty() && name.size() <= kLongestName && std::ranges::all_of(name, is_plain);
}

}  // namespace palpate::client
