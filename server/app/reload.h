// Takes over what changed in the configuration file while the daemon runs (SIGHUP).
//
// Only keys whose text in the file is another than when it was read last: what clients
// set meanwhile stays, unless the file now says otherwise. All of a file is taken over,
// or nothing. Never touches the servo: a changed setting reaches it as a client's does.
//
// Threads: main; waits up to 2 s for the servo to use new settings. Errors: none; they
// are lines in the log.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "server/app/config.h"
#include "server/security/policy.h"
#include "server/session/session.h"

namespace palpate {

// Reads and checks it again; throws ConfigError.
using ConfigReader = std::function<LoadedConfig()>;

// Keys that one of the two has and the other one has not, or has otherwise.
std::vector<std::string> ChangedKeys(const ConfigKeys& before, const ConfigKeys& after);

// A key that can change while the daemon runs: [haptics], isovalues, [log], and who may
// do what.
// The rest is what threads, sockets and the device were made from.
bool IsLive(const std::string& key);

// What of these keys is felt, as the configuration has it.
SettingsUpdate UpdateOf(const std::vector<std::string>& keys, const Config& config);

class ConfigReload {
 public:
  // Reads what a policy needs; throws where it cannot be used. What it returns takes it.
  using PolicyReader = std::function<std::function<void()>(const PolicyOptions&)>;

  // Borrows the session.
  ConfigReload(LoadedConfig current, ConfigReader read, Session& session, PolicyReader read_policy);

  bool IsPossible() const { return read_ != nullptr; }
  void Run() noexcept;

 private:
  void TakeOver();

  LoadedConfig current_;  // what runs
  ConfigReader read_;
  Session& session_;
  PolicyReader read_policy_;
};

}  // namespace palpate
