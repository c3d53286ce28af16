// Decides which palpated a program talks to, and with which credentials: by the name of a profile,
// or by the program's options and the environment. All clients of Palpate follow these rules.
//
// Profiles are tables of $XDG_CONFIG_HOME/palpate/clients.toml (else
// ~/.config/palpate/clients.toml):
//
//   [or-2]
//   server = "or-2.lab.example:7411"   # or: socket = "/run/palpate/palpated.sock"
//   tls_ca = "or-2-ca.pem"             # paths are relative to the file's folder
//   token_file = "or-2.token"          # or: tls_cert and tls_key
//
// A profile is complete: nothing is added to it. Without a profile, the environment fills what is
// not given:
//   PALPATE_SERVER      if neither a server nor a socket is named
//   PALPATE_TLS_CA      for a server
//   PALPATE_TOKEN_FILE  for a server, if TLS is used
//
// Threads: any; reads the environment and files. Errors: Error.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "client/sdk/connection.h"

namespace palpate::client {

struct ServerChoice {
  std::string profile{};  // empty: use the fields below
  Address address{};
  Credentials credentials{};
};

struct Server {
  Address address{};
  Credentials credentials{};
};

// Errors: kInvalidArgument (a broken profile, or a profile together with other fields), kNotFound
// (no such profile or file).
Server Resolve(const ServerChoice& choice);

// The socket that an address of this machine means now. Errors: kInvalidArgument (no role has that
// name), kPermissionDenied as DefaultSocketPath.
std::string SocketPathOf(const Address& address);

// One line of a list for people who choose a profile.
struct Profile {
  std::string name;
  std::string where;  // "or-2.lab.example:7411" or a socket's path; empty: the profile is broken
};

std::filesystem::path ProfilesFile();
// Sorted by name; empty if there is no file. Errors: kInvalidArgument if the file is not TOML.
std::vector<Profile> ListProfiles();

// True if it can be a profile's name: 1 to 64 letters, digits, '.', '_' or '-'.
bool IsProfileName(const std::string& name);

}  // namespace palpate::client
