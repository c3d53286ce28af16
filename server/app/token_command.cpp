#include "server/app/token_command.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "common/error/error.h"
#include "common/files/file_lock.h"
#include "server/app/client_folder.h"
#include "server/security/token_file.h"

namespace palpate {
namespace {

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
