#include "server/app/config_check.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "common/isosurface/decomposition.h"
#include "server/app/devices.h"
#include "server/client_paths/path_policy.h"
#include "server/metrics/exporter.h"
#include "server/security/certificates.h"
#include "server/security/token.h"
#include "server/services/server.h"
#include "server/session/volume_check.h"

namespace palpate {
namespace {

class Check {
 public:
  Check(const ConfigKeys& keys, ConfigUse use, const std::vector<ConfigFault>& known)
      : keys_(keys), use_(use), known_(known) {}

  ConfigUse use() const { return use_; }

  void Fault(const std::string& key, const std::string& what,
             ErrorKind kind = ErrorKind::kInvalidArgument) {
    const auto at = keys_.find(key);
    faults_.push_back({key, at == keys_.end() ? 0 : at->second.line, what, kind});
  }
  // Runs `attempt`. If `attempt` throws an Error, adds a fault with its message and returns false.
  bool Try(const std::string& key, const std::function<void()>& attempt) {
    try {
      attempt();
      return true;
    } catch (const Error& error) {
      Fault(key, error.what(), error.kind());
      return false;
    }
  }
  bool Readable(const std::string& key, const std::string& path) {
    if (path.empty() || access(path.c_str(), R_OK) == 0) return true;
    const int error = errno;
    if (use_ == ConfigUse::kReload) return false;
    Fault(key,
          "cannot read " + path + ": " + std::strerror(error) +
              "; correct the path, or who may read it",
          error == EACCES ? ErrorKind::kPermissionDenied : ErrorKind::kNotFound);
    return false;
  }
  // True if a key with this prefix is already known to be wrong. Its value in `config` is then not
  // the file's.
  bool Knows(std::string_view key) const {
    return std::any_of(known_.begin(), known_.end(),
                       [&](const ConfigFault& fault) { return fault.key.starts_with(key); });
  }

  // In the file, and not replaced by the command line.
  bool IsGiven(std::string_view key) const { return keys_.contains(key); }

  std::vector<ConfigFault> Take() { return std::move(faults_); }

 private:
  const ConfigKeys& keys_;
  const ConfigUse use_;
  const std::vector<ConfigFault>& known_;
  std::vector<ConfigFault> faults_;
};

constexpr char kNotBuiltin[] = "is for a file, and not for a builtin volume";

// One of the keys that gave this.
const char* GivenKey(const RawVoxels& raw) {
  if (!raw.type.empty()) return "volume.raw_type";
  if (raw.size[0] != 0) return "volume.raw_size";
  return raw.big_endian ? "volume.raw_big_endian" : "volume.raw_offset_bytes";
}

bool CheckSource(const Config& config, Check& check) {
  if (check.Knows("volume.source")) return false;
  const LoadRequest& volume = config.volume;
  if (volume.source.empty()) {
    check.Fault("volume.source", "must name a file, a folder or a builtin volume");
    return false;
  }
  if (!volume.source.starts_with("builtin:")) {
    return check.Readable("volume.source", volume.source);
  }
  if (volume.raw) check.Fault(GivenKey(*volume.raw), kNotBuiltin);
  for (const auto& [is_given, key] : {std::pair(volume.frame.has_value(), "volume.frame"),
                                      std::pair(!volume.grid.empty(), "volume.grid"),
                                      std::pair(!volume.component.empty(), "volume.component")}) {
    if (is_given) check.Fault(key, kNotBuiltin);
  }
  return check.Try("volume.source", [&] { CheckBuiltinSource(volume.source); });
}

// A reload does not use the folders: one may be gone.
void CheckFolders(const Config& config, Check& check) {
  if (check.use() == ConfigUse::kReload) return;
  const auto check_all = [&](const char* key, const auto& folders) {
    check.Try(key, [&] { PathPolicy({.load_folders = folders}); });
  };
  if (config.load_folders) check_all("volume.load_folders", *config.load_folders);
  if (config.save_folders) check_all("volume.save_folders", *config.save_folders);
  if (check.IsGiven("volume.upload_folder")) {
    check_all("volume.upload_folder", std::vector{config.uploads.folder});
  }
}

void CheckVolume(const Config& config, Check& check) {
  const LoadRequest& volume = config.volume;
  const bool has_source = CheckSource(config, check);
  const auto& spacing = volume.spacing_mm;
  const auto& scale = volume.device_mm_per_volume_mm;
  const bool has_spacing =
      !spacing || check.Try("volume.spacing_mm", [&] { CheckVoxelSpacing(*spacing); });
  if (scale) {
    // Some scales are wrong for every volume.
    const std::string source = has_source && has_spacing ? volume.source : "";
    check.Try("volume.device_mm_per_volume_mm",
              [&] { CheckScale(source, has_spacing ? spacing : std::nullopt, *scale); });
  }
  // The valid range depends on the volume, so it is known only after the load.
  if (volume.isovalue && !std::isfinite(*volume.isovalue)) {
    check.Fault("volume.isovalue", "must be a finite number");
  }
  if (volume.isovalue && volume.normalized_isovalue) {
    check.Fault("volume.normalized_isovalue", "must not be given together with volume.isovalue");
  }
  check.Try("volume.normalized_isovalue", [&] {
    CheckRange("normalized isovalue", volume.normalized_isovalue.value_or(0.5), 0.0, 1.0, "");
  });
  if (!volume.raw || volume.source.starts_with("builtin:") || check.Knows("volume.raw")) return;
  if (volume.raw->type.empty() || volume.raw->size[0] == 0) {
    check.Fault(GivenKey(*volume.raw), "needs others: set volume.raw_size and volume.raw_type");
  }
}

void CheckDevice(const Config& config, Check& check) {
  const bool has_firmware = check.Readable("device.falcon_firmware", config.device.falcon_firmware);
  const bool replays = config.device.kind == "replay" && !config.device.replay_file.empty();
  if (replays && !check.Readable("device.replay_file", config.device.replay_file)) return;
  if (!has_firmware && check.use() == ConfigUse::kReload) return;
  check.Try(replays ? "device.replay_file" : "device.kind", [&] {
    HandInboxes hand;
    const auto device = MakeDevice(config.device, std::max(1, config.realtime.priority - 1), hand);
    check.Try("device.stop_buttons", [&] { StopButtons(config.device, device->spec()); });
  });
}

// Keys that are of no use, or cannot work, without each other. Blames one that is in the file.
void CheckTlsKeys(const SecurityOptions& security, Check& check) {
  const PolicyOptions& policy = security.policy;
  const bool has_pair = !security.tls.certificate.empty();
  if (has_pair != !security.tls.key.empty()) {
    check.Fault(has_pair ? "tls.certificate" : "tls.key",
                "tls.certificate and tls.key come together: set both, or none");
  } else if (!has_pair && (!policy.tokens.empty() || !policy.client_ca.empty())) {
    check.Fault(policy.tokens.empty() ? "tls.client_ca" : "tls.tokens",
                "tls.tokens and tls.client_ca are of no use without TLS: set tls.certificate and "
                "tls.key");
  }
  if (policy.client_ca.empty() != policy.clients.empty()) {
    check.Fault(policy.clients.empty() ? "tls.client_ca" : "tls.client",
                "tls.client_ca and [[tls.client]] come together: the one says which certificates "
                "are genuine, the other what their names may do");
  }
}

// Checks the files of [tls] in the same way as the start of the daemon does.
void CheckTls(const SecurityOptions& security, Check& check) {
  if (!check.Knows("tls")) CheckTlsKeys(security, check);
  const auto now = std::chrono::system_clock::now();
  const TlsOptions& tls = security.tls;
  const bool has_pair = !tls.certificate.empty() && !tls.key.empty();
  const bool has_key = tls.key.empty() || check.Try("tls.key", [&] { CheckKey(tls.key); });
  const bool has_certificate = tls.certificate.empty() || check.Try("tls.certificate", [&] {
    CheckCertificate(tls.certificate, now);
  });
  if (has_pair && has_key && has_certificate) {
    check.Try("tls.key", [&] { CheckPair(tls.certificate, tls.key, now); });
  }
  const PolicyOptions& policy = security.policy;
  if (!policy.client_ca.empty()) {
    check.Try("tls.client_ca", [&] { ClientAuthority{policy.client_ca}; });
  }
  if (!policy.tokens.empty()) check.Try("tls.tokens", [&] { ReadTokenFile(policy.tokens); });
}

void CheckAddresses(const Config& config, Check& check) {
  check.Try("server.socket", [&] {
    if (!config.socket_path.empty()) UnixTarget(config.socket_path);
  });
  const SocketGroups& groups = config.groups;
  for (const auto& [key, group] : {std::pair("server.operator_group", groups.operators),
                                   std::pair("server.editor_group", groups.editors),
                                   std::pair("server.viewer_group", groups.viewers),
                                   std::pair("server.door_group", groups.door)}) {
    check.Try(key, [&, &group = group] {
      if (!group.empty()) GroupOf(group);
    });
  }
  // Skipped if [tls] has a fault: the values that could not be read may allow this address.
  if (config.listen && !check.Knows("tls")) {
    check.Try("server.listen", [&] { CheckListen(*config.listen, config.security); });
  }
  if (config.metrics_listen) {
    check.Try("metrics.listen", [&] { CheckMetricsListen(*config.metrics_listen); });
  }
}

}  // namespace

ConfigError::ConfigError(const std::filesystem::path& file, const std::vector<ConfigFault>& faults)
    : Error(faults.front().kind, ToText(file, faults.front())) {
  for (const ConfigFault& fault : faults) lines_.push_back(ToText(file, fault));
}

std::vector<ConfigFault> CheckConfig(const Config& config, const ConfigKeys& keys, ConfigUse use,
                                     const std::vector<ConfigFault>& known) {
  Check check(keys, use, known);
  CheckVolume(config, check);
  check.Try("haptics.free_side",
            [&] { CheckSide(config.haptics.layers, config.haptics.free_side); });
  CheckFolders(config, check);
  CheckDevice(config, check);
  CheckTls(config.security, check);
  CheckAddresses(config, check);
  if (config.realtime.cpu >= sysconf(_SC_NPROCESSORS_CONF)) {
    check.Fault("realtime.cpu", "is no core of this machine");
  }
  return check.Take();
}

LoadedConfig LoadConfig(const std::filesystem::path& file, const ConfigOverrides& overrides,
                        ConfigUse use) {
  LoadedConfig loaded{.config = {}, .keys = {}, .file = file};
  auto [keys, faults] = ReadConfig(file, overrides, loaded.config);
  loaded.keys = std::move(keys);
  // If the file is not valid TOML, its keys are unknown.
  if (std::none_of(faults.begin(), faults.end(),
                   [](const auto& fault) { return fault.key.empty(); })) {
    const std::vector<ConfigFault> more = CheckConfig(loaded.config, loaded.keys, use, faults);
    faults.insert(faults.end(), more.begin(), more.end());
  }
  if (faults.empty()) return loaded;
  for (ConfigFault& fault : faults) {
    const auto at = std::find_if(overrides.begin(), overrides.end(),
                                 [&](const auto& one) { return one.key == fault.key; });
    if (fault.line == 0 && at != overrides.end()) fault.key = at->option;
  }
  // The parser sorts tables by name; people read a file by lines.
  std::stable_sort(faults.begin(), faults.end(),
                   [](const auto& a, const auto& b) { return a.line < b.line; });
  throw ConfigError(file, faults);
}

int CheckConfigFile(const std::filesystem::path& file, const ConfigOverrides& overrides) {
  try {
    LoadConfig(file, overrides);
  } catch (const ConfigError& error) {
    for (const std::string& line : error.lines()) std::fprintf(stderr, "%s\n", line.c_str());
    return ExitCode(ErrorKind::kInvalidArgument);
  }
  std::printf("%s: ok\n", file.empty() ? "the command line (no --config is given)" : file.c_str());
  return 0;
}

}  // namespace palpate
