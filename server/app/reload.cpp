#include "server/app/reload.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <iterator>
#include <set>
#include <utility>

#include "server/app/config_check.h"
#include "server/app/log.h"
#include "server/log/log.h"
#include "server/session/setting_checks.h"

namespace palpate {
namespace {

const std::set<std::string, std::less<>> kPolicyKeys = {
    "server.socket_role", "server.loopback_role", "tls.client_ca", "tls.client", "tls.tokens"};
const std::set<std::string, std::less<>> kLiveKeys = {"log.level", "volume.isovalue",
                                                      "volume.normalized_isovalue"};

bool Names(const std::vector<std::string>& keys, std::string_view key) {
  return std::find(keys.begin(), keys.end(), key) != keys.end();
}

bool IsEmpty(const SettingsUpdate& update) {
  return !update.isovalue && !update.normalized_isovalue && update.numbers.empty() &&
         update.flags.empty() && update.choices.empty() && !update.layers;
}

// Copies the part that can change while the daemon runs.
void CopyLive(const LoadedConfig& from, LoadedConfig& to) {
  to.config.haptics = from.config.haptics;
  to.config.volume.isovalue = from.config.volume.isovalue;
  to.config.volume.normalized_isovalue = from.config.volume.normalized_isovalue;
  to.config.security.policy = from.config.security.policy;
  std::erase_if(to.keys, [](const auto& entry) { return IsLive(entry.first); });
  std::copy_if(from.keys.begin(), from.keys.end(), std::inserter(to.keys, to.keys.end()),
               [](const auto& entry) { return IsLive(entry.first); });
}

}  // namespace

std::vector<std::string> ChangedKeys(const ConfigKeys& before, const ConfigKeys& after) {
  std::vector<std::string> changed;
  for (const auto& [key, entry] : after) {
    const auto old = before.find(key);
    if (old == before.end() || old->second.value != entry.value) changed.push_back(key);
  }
  for (const auto& [key, entry] : before) {
    if (!after.contains(key)) changed.push_back(key);
  }
  std::sort(changed.begin(), changed.end());
  return changed;
}

bool IsLive(const std::string& key) {
  return key.starts_with("haptics.") || kLiveKeys.contains(key) || kPolicyKeys.contains(key);
}

SettingsUpdate UpdateOf(const std::vector<std::string>& keys, const Config& config) {
  SettingsUpdate update;
  const auto is_named = [&](std::string_view key) {
    return Names(keys, "haptics." + std::string(key));
  };
  for (const NumberSetting& setting : kNumberSettings) {
    if (!is_named(setting.key)) continue;
    update.numbers.emplace_back(setting.member, config.haptics.*setting.member);
  }
  for (const FlagSetting& setting : kFlagSettings) {
    if (!is_named(setting.key)) continue;
    update.flags.emplace_back(setting.member, config.haptics.*setting.member);
  }
  for (const ChoiceSetting& setting : kChoiceSettings) {
    if (!is_named(setting.key)) continue;
    update.choices.emplace_back(&setting, setting.get(config.haptics));
  }
  if (is_named("layer")) update.layers = config.haptics.layers;
  if (Names(keys, "volume.isovalue") || Names(keys, "volume.normalized_isovalue")) {
    update.isovalue = config.volume.isovalue;
    update.normalized_isovalue = config.volume.normalized_isovalue;
  }
  return update;
}

ConfigReload::ConfigReload(LoadedConfig current, ConfigReader read, Session& session,
                           PolicyReader read_policy)
    : current_(std::move(current)),
      read_(std::move(read)),
      session_(session),
      read_policy_(std::move(read_policy)) {}

void ConfigReload::Run() noexcept {
  const auto refuse = [](std::string_view why) {
    LogError("the configuration stays as it is: {}", why);
  };
  try {
    TakeOver();
  } catch (const ConfigError& error) {
    for (const std::string& line : error.lines()) refuse(line);
  } catch (const std::exception& error) {
    refuse(error.what());
  }
}

void ConfigReload::TakeOver() {
  const LoadedConfig next = read_();
  const std::vector<std::string> changed = ChangedKeys(current_.keys, next.keys);
  std::vector<std::string> live, later;
  std::partition_copy(changed.begin(), changed.end(), std::back_inserter(live),
                      std::back_inserter(later), IsLive);
  // Changes that may be refused come first. The policy is read even if no key changed: certificates
  // and tokens may have been replaced.
  const std::function<void()> take_policy = read_policy_(next.config.security.policy);
  SettingsUpdate update = UpdateOf(live, next.config);
  update.behind_layers = true;
  if (!IsEmpty(update)) {
    try {
      session_.Update(update);
    } catch (const RangeError& error) {
      // All other ranges were checked before. These depend on the volume.
      const std::string& name = error.name();
      throw AtKey(next,
                  name.starts_with("layer ") ? "haptics.layer"
                  : name == "tool_radius_mm" ? "haptics.tool_radius_mm"
                                             : "volume.isovalue",
                  error);
    } catch (const Error& error) {
      // A replay keeps settings from changing. It must not keep a token valid.
      if (error.kind() == ErrorKind::kConflict) take_policy();
      throw;
    }
  }
  if (Names(live, "log.level")) SetLogLevel(next.config.log_level);
  take_policy();
  CopyLive(next, current_);
  LogInfo(
      "configuration read again: {}",
      live.empty() ? "nothing to take over" : fmt::format("{} taken over", fmt::join(live, ", ")));
  if (!later.empty()) {
    LogWarning("{} changed too: in force after a restart", fmt::join(later, ", "));
  }
}

}  // namespace palpate
