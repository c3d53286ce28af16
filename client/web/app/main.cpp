// palpate-web: serves guests' browsers. Parses the command line and dispatches.
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <vector>

#include "client/program/server_options.h"
#include "client/sdk/calls.h"
#include "client/web/app/config.h"
#include "client/web/app/run.h"
#include "client/web/logins/secret.h"
#include "common/arguments/arguments.h"
#include "common/error/error.h"
#include "common/error/text.h"

namespace palpate::web {
namespace {

struct CommandLine {
  client::ServerChoice palpated{};
  std::string config_file, listen, public_url, page, room_key_file, metrics, publish, from, room;
  bool no_volume = false;
  bool check_config = false;
  bool wants_user = false;
  std::string user;
  std::vector<std::string> may_steer;
  NatsUserLine nats_user{};
};

void AddOptions(arguments::Command& app, CommandLine& line) {
  app.add_option("--config", line.config_file, "Configuration file; options go before it")
      ->option_text("FILE")
      ->check(arguments::ExistingFile());
  app.add_option("--listen", line.listen, "Address for browsers [default: 127.0.0.1:7480]")
      ->option_text("HOST:PORT");
  app.add_option("--public-url", line.public_url,
                 "What guests type, such as https://palpate.example.org, with the path if a proxy\n"
                 "serves it below one\n"
                 "[default: http://localhost and the port]")
      ->option_text("URL");
  app.add_option("--page", line.page, "Folder of the page [default: the one that was built]")
      ->option_text("FOLDER");
  app.add_flag("--no-volume", line.no_volume,
               "Guests see an overview of the volume alone, not its voxels");
  app.add_option("--room-key-file", line.room_key_file,
                 "Holds the key of the room link [default: a new key at every start]")
      ->option_text("FILE");
  app.add_option("--metrics", line.metrics, "Loopback address for Prometheus [default: none]")
      ->option_text("HOST:PORT");
  app.add_option("--publish", line.publish, "NATS server on which palpated's room is published")
      ->option_text("URL");
  app.add_option("--from", line.from, "NATS server whose room guests see, instead of a palpated")
      ->option_text("URL");
  app.add_option("--room", line.room, "Room on the NATS server")->option_text("NAME");
  app.add_flag("--check-config", line.check_config, "Says what is wrong, and ends");
  client::AddServerOptions(app, line.palpated);
}

void AddUser(arguments::Command& app, CommandLine& line) {
  arguments::Command* const user = app.add_subcommand(
      "user", "Prints a new token for a user, and the lines for the configuration file");
  user->add_option("NAME", line.user, "Letters, digits, '.', '_' and '-'")->required();
  user->add_option("--may-steer", line.may_steer, "Setting that the user may change; repeatable")
      ->option_text("KEY")
      ->expected(1)
      ->take_all();
  user->callback([&line] { line.wants_user = true; });
}

void PrintUser(const CommandLine& line) {
  if (!client::IsProfileName(line.user)) {
    Refuse(line.user + " is no name for a user: use 1 to 64 letters, digits and ._-");
  }
  const std::string token = NewSecret(256);
  const std::string hash = ToHex(Sha256(token));
  std::string keys;
  for (const std::string& key : line.may_steer) {
    CheckSettingKey(key);
    keys += (keys.empty() ? "\"" : ", \"") + key + "\"";
  }
  std::printf(
      "# For %s alone; it is not shown again: %s\n\n[[user]]\nname = \"%s\"\n"
      "token_sha256 = \"%s\"\nmay_steer = [%s]\n",
      line.user.c_str(), token.c_str(), line.user.c_str(), hash.c_str(), keys.c_str());
}

bool NamesServer(const client::ServerChoice& choice) {
  const client::Credentials& who = choice.credentials;
  return !choice.profile.empty() || !choice.address.socket_path.empty() ||
         !choice.address.host_port.empty() || !choice.address.role.empty() ||
         !who.ca_file.empty() || !who.certificate_file.empty() || !who.key_file.empty() ||
         !who.token_file.empty();
}

// The command line goes before the file; a server named there replaces the file's altogether, and
// what it says of a room says whether this gateway publishes one or receives it.
void Apply(const CommandLine& line, Config& config) {
  if (NamesServer(line.palpated)) config.palpated = line.palpated;
  if (!line.listen.empty()) config.http.listen = ParseHostPort(line.listen);
  if (!line.public_url.empty()) config.http.public_url = line.public_url;
  if (!line.page.empty()) config.http.page_folder = line.page;
  if (config.http.page_folder.empty()) config.http.page_folder = DefaultPageFolder();
  if (line.no_volume) config.with_groups = false;
  if (!line.room_key_file.empty()) config.room_key_file = line.room_key_file;
  if (!line.metrics.empty()) config.metrics = ParseHostPort(line.metrics);
  if (!line.publish.empty() || !line.from.empty()) {
    config.nats.publish = line.publish;
    config.nats.from = line.from;
  }
  if (!line.room.empty()) config.nats.options.room = line.room;
}

int Fail(const std::string& message, int exit_code) {
  std::fprintf(stderr, "palpate-web: %s\n", OneLine(message).c_str());
  return exit_code;
}

int Main(int argc, char** argv) {
  CommandLine line;
  arguments::Command app("Serves guests' browsers what palpated's device feels.", "palpate-web");
  app.footer(
      "Exit codes: 0 ended in order, 2 wrong usage, 3 wrong value, 4 not found, 5 no permission,\n"
      "7 conflict (the port is in use), 1 anything else.\n"
      "Example: palpate-web --server 127.0.0.1:7400");
  app.set_version_flag("--version", std::string("palpate-web ") + PALPATE_VERSION);
  AddOptions(app, line);
  AddUser(app, line);
  AddNatsUser(app, line.nats_user);
  try {
    if (!app.parse(argc, argv)) return 0;
  } catch (const arguments::UsageError& error) {
    app.explain(error);
    return kUsageExitCode;
  }
  if (line.wants_user) {
    PrintUser(line);
    return 0;
  }
  if (line.nats_user.is_wanted) {
    std::fputs(NatsUserText(line.nats_user).c_str(), stdout);
    return 0;
  }
  Config config;
  std::vector<std::string> faults;
  if (!line.config_file.empty()) faults = ReadConfig(line.config_file, config);
  Apply(line, config);
  for (std::string& fault : CheckConfig(config)) faults.push_back(std::move(fault));
  int exit_code = 0;
  for (const std::string& fault : faults) {
    exit_code = Fail(fault, ExitCode(ErrorKind::kInvalidArgument));
  }
  if (exit_code != 0 || line.check_config) return exit_code;
  Serve(config);
}

// Returns the program's exit code.
int Guarded(int argc, char** argv) {
  try {
    return Main(argc, argv);
  } catch (const Error& error) {
    return Fail(error.what(), ExitCode(error.kind()));
  } catch (const std::exception& error) {
    return Fail(std::string("internal error: ") + error.what(), ExitCode(ErrorKind::kInternal));
  }
}

}  // namespace
}  // namespace palpate::web

int main(int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);
  palpate::client::Calls::SilenceTransport();
  const int exit_code = palpate::web::Guarded(argc, argv);
  std::fflush(nullptr);
  // Without the clean-up of libraries: threads of gRPC outlive its channels a little, and would
  // crash in an OpenSSL that has cleaned up.
  std::_Exit(exit_code);
}
