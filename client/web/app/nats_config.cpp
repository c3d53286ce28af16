#include "client/web/app/nats_config.h"

#include <set>
#include <string>

#include "client/web/app/secret_file.h"
#include "client/web/room/subjects.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

void CheckUse(const NatsConfig& nats) {
  if (!nats.publish.empty() && !nats.from.empty()) {
    Refuse("nats.publish and nats.from: a gateway publishes a room or serves one, not both");
  }
  if (!nats.url().empty() && !IsRoom(nats.options.room)) {
    Refuse("nats.room: name the room by 1 to 32 of a-z, 0-9, '_' and '-'");
  }
  const NatsServer& server = nats.options.server;
  if (nats.url().empty() &&
      !(nats.options.room.empty() && server.user.empty() && server.password_file.empty() &&
        server.ca_file.empty() && server.certificate_file.empty() && server.key_file.empty())) {
    Refuse("nats: give nats.publish or nats.from, or remove what stands there");
  }
  if (nats.publish.empty() && !nats.options.sites.empty()) {
    Refuse("site: belongs to the configuration of the gateway that publishes the room");
  }
  std::set<std::string> names;
  for (const RemoteSite& site : nats.options.sites) {
    if (!names.insert(site.name).second) Refuse("site: " + site.name + " stands there twice");
  }
}

}  // namespace

void CheckNats(const NatsConfig& nats,
               const std::function<void(const std::function<void()>& check)>& attempt) {
  NatsServer server = nats.options.server;
  server.url = nats.url();
  attempt([&] { CheckUse(nats); });
  if (!server.url.empty()) attempt([&] { Check(server); });
  if (!server.password_file.empty()) {
    attempt([&] { CheckSecretFile("nats.password_file", server.password_file); });
  }
  if (!server.key_file.empty()) {
    attempt([&] { CheckSecretFile("nats.tls_key", server.key_file); });
  }
}

}  // namespace palpate::web
