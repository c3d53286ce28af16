#include "client/web/app/run.h"

#include <crypt.h>

#include <array>
#include <functional>
#include <vector>

#include "client/web/logins/secret.h"
#include "client/web/room/room_protocol.h"
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

using Lines = std::vector<std::string>;

// A list of nats-server's configuration, an item a line.
std::string List(const std::string& indent, const std::string& name, const Lines& items) {
  std::string list = indent + name + ": [\n";
  for (const std::string& item : items) list += indent + "  " + item + "\n";
  return list + indent + "]\n";
}

std::string Quoted(const std::string& text) { return '"' + text + '"'; }

Lines Quoted(Lines texts) {
  for (std::string& text : texts) text = Quoted(text);
  return texts;
}

// What nats-server lets the user send and hear.
std::string PermissionsOf(const NatsUserLine& line, const Subjects& room) {
  const std::string inboxes = InboxPrefix(line.name) + ".>";
  Lines publish = {room.direct_get(room.kept_all()), room.steer(line.name)};
  Lines subscribe = {room.live_all(), room.kept_all(), inboxes};
  std::string responses;
  if (line.publishes) {
    publish = {room.kept_all(), room.live_all(), "$JS.API.STREAM.CREATE." + room.stream(),
               "$JS.API.STREAM.PURGE." + room.stream()};
    subscribe = {room.beat(), room.steer_all(), inboxes};
    responses = "      allow_responses: {max: 1, expires: \"10s\"}\n";
  }
  return "    permissions: {\n" + List("      ", "publish", Quoted(publish)) +
         List("      ", "subscribe", Quoted(subscribe)) + responses + "    }\n";
}

// What goes from the room's account to those of its receivers.
Lines Shared(
    const Subjects& subjects, const std::string& steer,
    const std::function<std::string(const std::string& kind, const std::string& subject)>& item) {
  return {item("stream", subjects.live_all()), item("stream", subjects.kept_all()),
          item("service", subjects.direct_get(subjects.kept_all())), item("service", steer)};
}

}  // namespace

void AddNatsUser(arguments::Command& app, NatsUserLine& line) {
  arguments::Command* const user = app.add_subcommand(
      "nats-user",
      "Prints a new password for a gateway's user at the NATS server, and an account\n"
      "for that server's configuration");
  user->add_option("NAME", line.name, "Letters, digits, '_' and '-'")->required();
  user->add_option("--room", line.room, "The room")->option_text("ROOM")->required();
  user->add_flag("--publishes", line.publishes, "The user publishes the room");
  user->callback([&line] { line.is_wanted = true; });
}

std::string NatsUserText(const NatsUserLine& line) {
  if (!IsNatsUser(line.name)) Refuse("a NATS user's name has 1 to 64 letters, digits, '_' and '-'");
  const Subjects subjects(line.room);
  const std::string room_account = "palpate." + line.room;
  const std::string password = NewSecret(256);
  const std::string user = "  users: [{\n    user: " + Quoted(line.name) +
                           "\n    password: " + Quoted(Bcrypt(password)) + "\n" +
                           PermissionsOf(line, subjects) + "  }]\n";
  const std::string begin =
      "# For " + line.name + " alone; it is not shown again: " + password + "\n\n";
  if (line.publishes) {
    return begin + Quoted(room_account) + ": {\n  jetstream: enabled\n" + user +
           List("  ", "exports",
                Shared(subjects, subjects.steer_all(),
                       [](const std::string& kind, const std::string& subject) {
                         return "{" + kind + ": " + Quoted(subject) + "}";
                       })) +
           "}\n";
  }
  return begin + Quoted(room_account + "." + line.name) + ": {\n" + user +
         List("  ", "imports",
              Shared(subjects, subjects.steer(line.name),
                     [&](const std::string& kind, const std::string& subject) {
                       return "{" + kind + ": {account: " + Quoted(room_account) +
                              ", subject: " + Quoted(subject) + "}}";
                     })) +
         "}\n";
}

}  // namespace palpate::web
