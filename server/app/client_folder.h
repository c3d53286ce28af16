// What a client needs to reach this daemon, in a folder to hand over: a profile, the token, and
// the certificate authority.
//
// Threads: main. Errors: Error.
#pragma once

#include <filesystem>
#include <string>

namespace palpate {

struct ClientFolder {
  std::filesystem::path folder{};   // made where it is missing
  std::string server{};             // HOST:PORT, as clients reach it
  std::filesystem::path ca_file{};  // copied
  std::string profile{};            // empty: the host's name up to its first dot
};

// Writes clients.toml (or adds to the one that is there), PROFILE.token of mode 0600 and
// PROFILE-ca.pem. Returns the profile's name. The files are those of client/sdk/server_choice.h.
// Errors: kInvalidArgument (an address or a name that is none, no certificate), kConflict (a
// profile of that name is there), kNotFound, or as NewFile.
std::string WriteClientFolder(const ClientFolder& client, const std::string& token);

}  // namespace palpate
