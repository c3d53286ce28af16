// What palpate-web is told: the configuration file, with the command line over it.
//
// Threads: main only; reads files.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/sdk/server_choice.h"
#include "client/web/http/http_options.h"
#include "client/web/logins/access.h"
#include "client/web/room/nats_link.h"
#include "common/wire/address.h"

namespace palpate::web {

// The room of a NATS server that this gateway publishes, or that it serves to its guests.
struct NatsConfig {
  std::string publish{};  // URL: what palpated does goes there
  std::string from{};     // URL: guests see what comes from there; no palpated is followed
  // The file's keys: the room, the server without its URL, and sites, which may steer from
  // elsewhere if this gateway publishes.
  RoomOptions options{};

  // Empty: no NATS server is used.
  const std::string& url() const { return publish.empty() ? from : publish; }
};

struct Config {
  client::ServerChoice palpated{};
  HttpOptions http{};
  bool with_groups = true;
  std::filesystem::path room_key_file{};  // empty: a new key at every start
  std::vector<User> users{};
  std::optional<HostPort> metrics{};
  NatsConfig nats{};
};

// Reads `file` into `config`. Returns what is wrong, one line each with file, line and key. Keys
// that are wrong keep their value.
std::vector<std::string> ReadConfig(const std::filesystem::path& file, Config& config);

// Returns what makes a whole configuration useless; empty: nothing. An address that is not loopback
// needs TLS or a proxy in front. Looks for the files that are named.
std::vector<std::string> CheckConfig(const Config& config);

// The key in the file, without white space at its ends. Errors: kNotFound, kPermissionDenied,
// kInvalidArgument (others may write the file or all may read it, the key is too short).
std::string ReadRoomKey(const std::filesystem::path& file);

// Throws kInvalidArgument if no setting has this key.
void CheckSettingKey(const std::string& key);

// The page beside the program: in the build folder or the package.
std::filesystem::path DefaultPageFolder();

}  // namespace palpate::web
