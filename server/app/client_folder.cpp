#include "server/app/client_folder.h"

#include <toml++/toml.h>
#include <algorithm>
#include <fstream>
#include <sstream>

#include "common/error/error.h"
#include "common/files/new_file.h"
#include "common/wire/address.h"
#include "server/security/token.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

// Returns "" if there is no such file.
std::string TextOf(const fs::path& path) {
  std::error_code error;
  std::ifstream file(path, std::ios::binary);
  if (!file && fs::exists(fs::symlink_status(path, error))) {
    throw Error(ErrorKind::kPermissionDenied, "cannot read " + path.string());
  }
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

std::string Certificate(const fs::path& path) {
  std::string text = TextOf(path);
  if (text.find("BEGIN CERTIFICATE-----") == text.npos ||
      text.find("PRIVATE KEY-----") != text.npos) {
    throw Error(ErrorKind::kInvalidArgument,
                path.string() +
                    " must hold a certificate in PEM and no private key: name the "
                    "certificate that clients must trust");
  }
  return text;
}

void CheckIsNew(const fs::path& file, const std::string& text, const std::string& profile) {
  toml::table profiles;
  try {
    profiles = toml::parse(text);
  } catch (const toml::parse_error& error) {
    throw Error(ErrorKind::kInvalidArgument,
                file.string() + " is not TOML: " + std::string(error.description()));
  }
  if (profiles.contains(profile)) {
    throw Error(ErrorKind::kConflict, file.string() + " has a profile " + profile +
                                          ": choose another name with --profile");
  }
}

// "ada-scanner": profiles of two users, or of two hosts, have different files.
std::string ProfileOf(const std::string& token_name, const std::string& host) {
  const bool is_address = host.find_first_not_of("0123456789.:") == host.npos;
  std::string name = token_name + "-" + (is_address ? host : host.substr(0, host.find('.')));
  std::replace(name.begin(), name.end(), ':', '-');
  return name;
}

void Write(const fs::path& path, const std::string& text, mode_t mode, IfThere if_there) {
  NewFile file(path, if_there, mode);
  file.Write(text);
  file.TakeName();
}

}  // namespace

std::string WriteClientFolder(const ClientFolder& client, const std::string& token) {
  const HostPort server = ParseHostPort(client.server);
  const std::string profile =
      client.profile.empty() ? ProfileOf(client.token_name, server.host) : client.profile;
  CheckTokenName(profile);  // the same rules
  const std::string certificate = Certificate(client.ca_file);
  MakeFolders(client.folder);
  const fs::path file = client.folder / "clients.toml";
  std::string text = TextOf(file);
  CheckIsNew(file, text, profile);
  if (!text.empty()) text += "\n";
  text += "[\"" + profile + "\"]\nserver = \"" + server.ToString() + "\"\ntls_ca = \"" + profile +
          "-ca.pem\"\ntoken_file = \"" + profile + ".token\"\n";
  Write(client.folder / (profile + "-ca.pem"), certificate, 0644, IfThere::kRefuse);
  Write(client.folder / (profile + ".token"), token + "\n", 0600, IfThere::kRefuse);
  Write(fs::weakly_canonical(file), text, 0644, IfThere::kReplace);
  return profile;
}

}  // namespace palpate
