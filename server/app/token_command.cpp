#include <toml++/toml.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "common/error/error.h"
#include "common/files/file_lock.h"
#include "common/files/new_file.h"
#include "common/wire/address.h"
#include "server/app/run.h"
#include "server/security/token.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

// A folder with all that a client needs to reach this daemon: a profile, the token, and the
// certificate authority. The administrator hands the folder over.
struct ClientFolder {
  std::string token_name{};
  std::filesystem::path folder{};   // created if missing
  std::string server{};             // HOST:PORT, as clients reach it
  std::filesystem::path ca_file{};  // copied
  std::string profile{};            // empty: token and host, "ada-scanner"
};

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

// Writes clients.toml (or adds to an existing one), PROFILE.token with mode 0600, and
// PROFILE-ca.pem. Returns the profile's name. client/sdk/server_choice.h reads these files.
// Errors: kInvalidArgument (an invalid address or name, or no certificate), kConflict (a profile of
// that name exists), kNotFound, and those of NewFile.
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

constexpr std::chrono::seconds kLockPatience{5};

struct ClientFolderValues {
  std::string folder, server, ca_file, profile;
};

struct TokenValues {
  std::string file = "/etc/palpate/tokens.toml";
  std::string name;
  std::string role;
  unsigned days = 0;  // 0: no expiry
  ClientFolderValues client;
};

// Each command reads the file and writes it again. Of two commands at a time, one waits.
FileLock LockFolderOf(const std::filesystem::path& file) {
  FileLock lock;
  switch (
      lock.Take(std::filesystem::absolute(file).parent_path(), LockOf::kFolder, kLockPatience)) {
    case LockResult::kTaken:
      break;
    case LockResult::kCannotOpen:
      throw Error(ErrorKind::kNotFound, "there is no folder for " + file.string() + ": make it");
    case LockResult::kHeldByAnother:
      // Any user who may read the folder can hold its lock.
      throw Error(ErrorKind::kConflict, "another program holds the lock of the folder of " +
                                            file.string() + ": end it ('fuser' names it)");
  }
  return lock;
}

std::vector<StoredToken> ReadOrNone(const std::string& file) {
  return std::filesystem::exists(file) ? ReadTokenFile(file) : std::vector<StoredToken>();
}

auto TokenNamed(std::vector<StoredToken>& tokens, const std::string& name) {
  return std::find_if(tokens.begin(), tokens.end(),
                      [&](const StoredToken& token) { return token.name == name; });
}

void Tell(const TokenValues& values, const NewToken& token, const std::string& profile) {
  const std::string until =
      token.stored.expires ? " until " + ToText(*token.stored.expires) : std::string();
  std::fprintf(stderr, "%s is now %s%s.\n", values.name.c_str(), values.role.c_str(),
               until.c_str());
  if (profile.empty()) {
    // Only the token goes to stdout, so that it can be redirected into a file.
    std::printf("%s\n", token.text.c_str());
    std::fprintf(stderr,
                 "This token is shown once: give it to the client in a file of mode 0600.\n");
    return;
  }
  std::fprintf(stderr,
               "Copy the files of %s to ~/.config/palpate on the client's machine, then: palpate "
               "--profile %s info\n",
               values.client.folder.c_str(), profile.c_str());
}

void Add(const TokenValues& values) {
  const auto role = Named<Role>(values.role);
  if (!role) {
    throw Error(ErrorKind::kInvalidArgument,
                "there is no role " + values.role + ": give viewer, editor, operator or admin");
  }
  const FileLock lock = LockFolderOf(values.file);
  std::vector<StoredToken> tokens = ReadOrNone(values.file);
  if (TokenNamed(tokens, values.name) != tokens.end()) {
    throw Error(ErrorKind::kConflict,
                "there is a token of that name: revoke it first, or choose another name");
  }
  NewToken token = MakeToken(values.name, *role);
  if (values.days > 0) {
    const auto now =
        std::chrono::time_point_cast<std::chrono::seconds>(std::chrono::system_clock::now());
    token.stored.expires = now + std::chrono::days(values.days);
  }
  tokens.push_back(token.stored);
  // The client's folder is written first. If that fails, the daemon does not know the token.
  std::string profile;
  const ClientFolderValues& client = values.client;
  if (!client.folder.empty())
    profile = WriteClientFolder({.token_name = values.name,
                                 .folder = client.folder,
                                 .server = client.server,
                                 .ca_file = client.ca_file,
                                 .profile = client.profile},
                                token.text);
  WriteTokenFile(values.file, tokens);
  Tell(values, token, profile);
}

void List(const TokenValues& values) {
  const std::vector<StoredToken> tokens = ReadTokenFile(values.file);
  if (tokens.empty()) std::fprintf(stderr, "%s has no tokens.\n", values.file.c_str());
  for (const StoredToken& token : tokens) {
    std::printf("%-24s %-10s%s\n", token.name.c_str(), NameOf(token.role).data(),
                token.expires ? ("until " + ToText(*token.expires)).c_str() : "");
  }
}

void Revoke(const TokenValues& values) {
  const FileLock lock = LockFolderOf(values.file);
  std::vector<StoredToken> tokens = ReadTokenFile(values.file);
  const auto at = TokenNamed(tokens, values.name);
  if (at == tokens.end()) {
    throw Error(ErrorKind::kNotFound, "there is no token of that name in " + values.file);
  }
  tokens.erase(at);
  WriteTokenFile(values.file, tokens);
  std::fprintf(stderr, "%s is revoked: palpated ends its streams within seconds.\n",
               values.name.c_str());
}

}  // namespace

void AddTokenCommands(arguments::Command& app, std::function<void()>& run) {
  const auto values = std::make_shared<TokenValues>();
  arguments::Command* token = app.add_subcommand("token", "Tokens of clients over TLS");
  token->require_subcommand(1);
  const auto add = [&](const std::string& name, const std::string& about,
                       void (*command)(const TokenValues&)) {
    arguments::Command* sub = token->add_subcommand(name, about);
    sub->add_option("--file", values->file, "tls.tokens of the configuration")
        ->capture_default_str();
    sub->callback([&run, values, command] { run = [values, command] { command(*values); }; });
    return sub;
  };
  arguments::Command* make = add("add", "Makes a token, stores its hash and prints it once", Add);
  make->add_option("name", values->name, "Name of the token's owner: letters, digits and ._-")
      ->required();
  make->add_option("--role", values->role, "viewer, editor, operator or admin")->required();
  make->add_option("--days", values->days, "days until the token expires [never]")
      ->check(arguments::Range(1u, 3650u));
  arguments::Option* const folder = make->add_option(
      "--client-folder", values->client.folder,
      "write all that the client needs into this folder instead of printing the token: "
      "clients.toml with a profile, the token, the certificate authority");
  arguments::Option* const server =
      make->add_option("--server", values->client.server,
                       "HOST:PORT of this palpated, as the client reaches it")
          ->needs(folder);
  arguments::Option* const ca =
      make->add_option(
              "--tls-ca", values->client.ca_file,
              "certificate authority that the client must trust, or tls.certificate itself")
          ->needs(folder);
  folder->needs(server)->needs(ca);
  make->add_option("--profile", values->client.profile,
                   "name of the profile [token's and host's: ada-scanner]")
      ->needs(folder);
  add("list", "Shows names and roles", List);
  add("revoke", "Removes a token: within seconds its calls are refused and its streams end", Revoke)
      ->add_option("name", values->name, "Name of the token's owner")
      ->required();
}

}  // namespace palpate
