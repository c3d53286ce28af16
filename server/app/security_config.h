// The configuration's keys of security: who may do what, TLS, limits.
//
// Threads: main. Errors: as of config.h.
#pragma once

#include <functional>
#include <map>
#include <string>

#include "server/app/config.h"
#include "server/app/config_entry.h"
#include "server/rpc/server.h"

namespace palpate {

// By the whole key, "tls.certificate".
std::map<std::string, std::function<void(const ConfigEntry&, SecurityOptions&)>> SecuritySetters();

// What no single key can tell. Nothing where one of [tls] is wrong by itself.
void AppendSecurityFaults(const SecurityOptions& options, ConfigReading& reading);

}  // namespace palpate
