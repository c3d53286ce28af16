#include "client/web/app/nats_user.h"

#include <crypt.h>

#include <array>
#include <vector>

#include "client/web/access/secret.h"
#include "client/web/nats/subjects.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

// The only kind of hash that nats-server knows. At the least cost: nobody guesses 256 random bits,
// and the server pays for each password that a stranger sends.
std::string Bcrypt(const std::string& password) {
  std::array<char, CRYPT_GENSALT_OUTPUT_SIZE> salt{};
  crypt_data data{};
  // The system's random bytes.
  if (crypt_gensalt_rn("$2b$", 4, nullptr, 0, salt.data(), static_cast<int>(salt.size()))) {
    const char* const hash = crypt_r(password.c_str(), salt.data(), &data);
    if (hash && hash[0] == '$') return hash;
  }
  throw Error(ErrorKind::kInternal, "libcrypt makes no bcrypt hash");
}

std::string List(const std::vector<std::string>& subjects) {
  std::string list;
  for (const std::string& subject : subjects) {
    list += (list.empty() ? "[\"" : ",\n                \"") + subject + "\"";
  }
  return list + "]";
}

}  // namespace

void AddNatsUser(arguments::Command& app, NatsUserLine& line) {
  arguments::Command* const user = app.add_subcommand(
      "nats-user",
      "Prints a new password for a user of a room on NATS, and the user's lines for\n"
      "the configuration file of nats-server");
  user->add_option("NAME", line.name, "Letters, digits, '_' and '-'")->required();
  user->add_option("--room", line.room, "Room that the user may watch, and steer by request")
      ->option_text("ROOM")
      ->required();
  user->add_flag("--publishes", line.publishes, "The user publishes the room instead");
  user->callback([&line] { line.is_wanted = true; });
}

std::string NatsUserText(const NatsUserLine& line) {
  const NatsUserPermissions may = PermissionsOf(line.room, line.name, line.publishes);
  const std::string password = NewSecret(256);
  std::string text = "# For " + line.name + " alone; it is not shown again: " + password + "\n\n" +
                     "{\n  user: \"" + line.name + "\"\n  password: \"" + Bcrypt(password) +
                     "\"\n  permissions: {\n    publish: {\n      allow: " + List(may.publish) +
                     "\n    }\n    subscribe: {\n      allow: " + List(may.subscribe) + "\n    }\n";
  if (may.allows_responses) text += "    allow_responses: {max: 1, expires: \"10s\"}\n";
  return text + "  }\n}\n";
}

}  // namespace palpate::web
