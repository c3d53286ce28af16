#include "client/web/app/nats_config.h"

#include <functional>
#include <set>
#include <string>

#include "client/web/app/secret_file.h"
#include "client/web/nats/subjects.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

void CheckUse(const NatsConfig& nats) {
  if (!nats.publish.empty() && !nats.from.empty()) {
    Refuse("nats.publish and nats.from: a gateway publishes a room or serves one, not both");
  }
  if (nats.is_used() && !IsRoom(nats.room)) {
    Refuse("nats.room: name the room by 1 to 32 of a-z, 0-9, '_' and '-'");
  }
  const NatsServer& server = nats.server;
  if (!nats.is_used() &&
      !(nats.room.empty() && server.user.empty() && server.password_file.empty() &&
        server.ca_file.empty() && server.certificate_file.empty() && server.key_file.empty())) {
    Refuse("nats: give nats.publish or nats.from, or remove what stands there");
  }
  if (nats.publish.empty() && !nats.sites.empty()) {
    Refuse("site: belongs to the configuration of the gateway that publishes the room");
  }
  std::set<std::string> names;
  for (const RemoteSite& site : nats.sites) {
    if (!names.insert(site.name).second) Refuse("site: " + site.name + " stands there twice");
  }
}

}  // namespace

std::vector<std::string> CheckNats(const NatsConfig& nats) {
  std::vector<std::string> faults;
  const auto attempt = [&](const std::function<void()>& check) {
    try {
      check();
    } catch (const Error& error) {
      faults.emplace_back(error.what());
    }
  };
  const NatsServer& server = nats.server;
  attempt([&] { CheckUse(nats); });
  if (nats.is_used()) attempt([&] { Check(RoomOptionsOf(nats).server); });
  if (!server.password_file.empty()) {
    attempt([&] { CheckSecretFile("nats.password_file", server.password_file); });
  }
  if (!server.key_file.empty()) {
    attempt([&] { CheckSecretFile("nats.tls_key", server.key_file); });
  }
  return faults;
}

RoomOptions RoomOptionsOf(const NatsConfig& nats) {
  RoomOptions options;
  options.server = nats.server;
  options.server.url = nats.publish.empty() ? nats.from : nats.publish;
  options.room = nats.room;
  options.version = PALPATE_VERSION;
  options.sites = nats.sites;
  return options;
}

}  // namespace palpate::web
