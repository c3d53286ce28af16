// Which palpated a program talks to, and who it is there: by name, or by what its options and the
// environment say. All clients of Palpate follow these rules.
//
// Profiles are tables of $XDG_CONFIG_HOME/palpate/clients.toml (else
// ~/.config/palpate/clients.toml):
//
//   [or-2]
//   server = "or-2.lab.example:7411"   # or: socket = "/run/palpate/palpated.sock"
//   tls_ca = "or-2-ca.pem"             # paths are relative to the file's folder
//   token_file = "or-2.token"          # or: tls_cert and tls_key
//
// A profile is whole: nothing is added to it. Without one the environment fills what is not given:
// PALPATE_SERVER where neither a server nor a socket is named; and, for a server, PALPATE_TLS_CA,
// and PALPATE_TOKEN_FILE if TLS is used.
//
// Threads: any; reads the environment and files. Errors: Error.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "client/sdk/connection.h"

namespace palpate::client {

struct ServerChoice {
  std::string profile{};  // empty: what follows
  Address address{};
  Credentials credentials{};
};

struct Server {
  Address address{};
  Credentials credentials{};
};

// Errors: kInvalidArgument (a profile together with anything else, a profile that is not right),
// kNotFound (no such profile or file).
Server Resolve(const ServerChoice& choice);

// For people who choose one.
struct Profile {
  std::string name;
  std::string where;  // "or-2.lab.example:7411" or a socket's path; empty: it is not right
};

std::filesystem::path ProfilesFile();
// In the file's order of names; none where there is no file. Errors: kInvalidArgument for a file
// that is not TOML.
std::vector<Profile> ListProfiles();

// Whether it can be a profile's name: 1 to 64 letters, digits, '.', '_' or '-'.
bool IsProfileName(const std::string& name);

}  // namespace palpate::client
