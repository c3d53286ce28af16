#include "server/app/token_command.h"

#include <fcntl.h>
#include <sys/file.h>
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
#include "server/security/token_file.h"

namespace palpate {
namespace {

constexpr std::chrono::seconds kLockPatience{5};

struct TokenValues {
  std::string file = "/etc/palpate/tokens.toml";
  std::string name;
  std::string role;
};

// Of two commands at a time one waits: each reads the file and writes it anew.
class FolderLock {
 public:
  explicit FolderLock(const std::filesystem::path& file)
      : fd_(open(std::filesystem::absolute(file).parent_path().c_str(),
                 O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
    if (fd_ < 0) {
      throw Error(ErrorKind::kNotFound, "there is no folder for " + file.string() + ": make it");
    }
    // Whoever may read the folder can hold its lock.
    const auto end = std::chrono::steady_clock::now() + kLockPatience;
    while (flock(fd_, LOCK_EX | LOCK_NB) != 0) {
      if (std::chrono::steady_clock::now() > end) {
        close(fd_);
        throw Error(ErrorKind::kConflict, "another program holds the lock of the folder of " +
                                              file.string() + ": end it ('fuser' names it)");
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
  ~FolderLock() { close(fd_); }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  const int fd_;
};

std::vector<StoredToken> ReadOrNone(const std::string& file) {
  return std::filesystem::exists(file) ? ReadTokenFile(file) : std::vector<StoredToken>();
}

auto Named(std::vector<StoredToken>& tokens, const std::string& name) {
  return std::find_if(tokens.begin(), tokens.end(),
                      [&](const StoredToken& token) { return token.name == name; });
}

void Add(const TokenValues& values) {
  const auto role = RoleNamed(values.role);
  if (!role) {
    throw Error(ErrorKind::kInvalidArgument,
                "there is no role " + values.role + ": give viewer, editor, operator or admin");
  }
  const FolderLock lock(values.file);
  std::vector<StoredToken> tokens = ReadOrNone(values.file);
  if (Named(tokens, values.name) != tokens.end()) {
    throw Error(ErrorKind::kConflict,
                "there is a token of that name: revoke it first, or choose another name");
  }
  const NewToken token = MakeToken(values.name, *role);
  tokens.push_back(token.stored);
  WriteTokenFile(values.file, tokens);
  // The token alone on stdout, so that it can go into a file.
  std::printf("%s\n", token.text.c_str());
  std::fprintf(stderr,
               "%s is now %s. This token is shown once: give it to the client in a file "
               "of mode 0600.\n",
               values.name.c_str(), values.role.c_str());
}

void List(const TokenValues& values) {
  for (const StoredToken& token : ReadTokenFile(values.file)) {
    std::printf("%-24s %s\n", token.name.c_str(), NameOf(token.role).data());
  }
}

void Revoke(const TokenValues& values) {
  const FolderLock lock(values.file);
  std::vector<StoredToken> tokens = ReadTokenFile(values.file);
  const auto at = Named(tokens, values.name);
  if (at == tokens.end()) {
    throw Error(ErrorKind::kNotFound, "there is no token of that name in " + values.file);
  }
  tokens.erase(at);
  WriteTokenFile(values.file, tokens);
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
  make->add_option("name", values->name, "Whose it is: letters, digits and ._-")->required();
  make->add_option("--role", values->role, "viewer, editor, operator or admin")->required();
  add("list", "Shows names and roles", List);
  add("revoke", "Takes a token out: its calls are refused, and its streams end, in seconds", Revoke)
      ->add_option("name", values->name, "Whose it is")
      ->required();
}

}  // namespace palpate
