// Reads the configuration's keys of security: access rights, TLS and limits.
//
// Threads: main. Errors: as in config.h.
#pragma once

#include <functional>
#include <map>
#include <string>

#include "server/app/config.h"
#include "server/app/config_entry.h"
#include "server/rpc/server.h"

namespace palpate {

// By the full key, for example "tls.certificate".
std::map<std::string, std::function<void(const ConfigEntry&, SecurityOptions&)>> SecuritySetters();

// Adds faults of keys that do not fit each other. Adds nothing if a key of [tls] has a fault
// already.
void AppendSecurityFaults(const SecurityOptions& options, ConfigReading& reading);

}  // namespace palpate
