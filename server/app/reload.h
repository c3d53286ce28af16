// Applies changes of the configuration file while the daemon runs (SIGHUP).
//
// Applies only the keys whose text in the file has changed since the last read. A value that a
// client has set meanwhile therefore stays, unless its key has changed in the file. Either all
// changes of a file are applied, or none. Never calls the servo: a changed setting reaches the
// servo as a client's does.
//
// Threads: main. Waits up to 2 s for the servo to use the new settings. Errors: logged, never
// thrown.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "server/app/config.h"
#include "server/security/policy.h"
#include "server/session/session.h"

namespace palpate {

// Reads and checks the configuration file again. Throws ConfigError.
using ConfigReader = std::function<LoadedConfig()>;

// Returns the keys that only one of the two has, and the keys whose values differ.
std::vector<std::string> ChangedKeys(const ConfigKeys& before, const ConfigKeys& after);

// True if the key can change while the daemon runs: [haptics], isovalues, [log], and access rights.
// Threads, sockets and the device were made from the other keys.
bool IsLive(const std::string& key);

// Returns those of these keys that change what is felt, with the configuration's values.
SettingsUpdate UpdateOf(const std::vector<std::string>& keys, const Config& config);

class ConfigReload {
 public:
  // Reads the files of a policy; throws if the policy cannot be used. The returned function puts
  // the policy into force.
  using PolicyReader = std::function<std::function<void()>(const PolicyOptions&)>;

  // Borrows the session.
  ConfigReload(LoadedConfig current, ConfigReader read, Session& session, PolicyReader read_policy);

  bool IsPossible() const { return read_ != nullptr; }
  void Run() noexcept;

 private:
  void TakeOver();

  LoadedConfig current_;  // in force now
  ConfigReader read_;
  Session& session_;
  PolicyReader read_policy_;
};

}  // namespace palpate
