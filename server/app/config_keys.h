// The keys of the configuration file, and how each is read.
//
// Threads: main. Errors: Error (kInvalidArgument) that says what is wrong with a value. The caller
// adds the file's name, the line and the key.
#pragma once

#include <toml++/toml.h>
#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "server/app/config.h"

namespace palpate {

using ConfigSetter = std::function<void(const toml::node&, Config&)>;

// By the full key, for example "tls.certificate".
const std::map<std::string, ConfigSetter, std::less<>>& ConfigSetters();

// True if the key describes the file of volume.source, and not another one.
bool IsOfSource(std::string_view key);

}  // namespace palpate
