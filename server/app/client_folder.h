// Writes a folder with all that a client needs to reach this daemon: a profile, the token, and the
// certificate authority. The administrator hands the folder over.
//
// Threads: main. Errors: Error.
#pragma once

#include <filesystem>
#include <string>

namespace palpate {

struct ClientFolder {
  std::string token_name{};
  std::filesystem::path folder{};   // created if missing
  std::string server{};             // HOST:PORT, as clients reach it
  std::filesystem::path ca_file{};  // copied
  std::string profile{};            // empty: token and host, "ada-scanner"
};

// Writes clients.toml (or adds to an existing one), PROFILE.token with mode 0600, and
// PROFILE-ca.pem. Returns the profile's name. client/sdk/server_choice.h reads these files.
// Errors: kInvalidArgument (an invalid address or name, or no certificate), kConflict (a profile of
// that name exists), kNotFound, and those of NewFile.
std::string WriteClientFolder(const ClientFolder& client, const std::string& token);

}  // namespace palpate
