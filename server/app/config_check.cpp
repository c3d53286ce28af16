#include "server/app/config_check.h"

#include <sched.h>
#include <unistd.h>

#include <cstdio>

#include "common/error/error.h"
#include "common/isosurface/decomposition.h"
#include "server/app/devices.h"
#include "server/rpc/server.h"
#include "server/session/builtin_source.h"

namespace palpate {
namespace {

class Check {
 public:
  explicit Check(const ConfigKeys& keys) : keys_(keys) {}

  void Fault(const std::string& key, const std::string& what) {
    const auto known = keys_.find(key);
    faults_.push_back({key, known == keys_.end() ? 0 : known->second.line, what});
  }
  // `what` of the Error that `attempt` throws.
  void Try(const std::string& key, const std::function<void()>& attempt) {
    try {
      attempt();
    } catch (const Error& error) {
      Fault(key, std::string(": ") + error.what());
    }
  }
  void Readable(const std::string& key, const std::string& path) {
    if (!path.empty() && access(path.c_str(), R_OK) != 0) {
      Fault(key, ": " + path + " is not there, or may not be read");
    }
  }

  std::vector<ConfigFault> Take() { return std::move(faults_); }

 private:
  const ConfigKeys& keys_;
  std::vector<ConfigFault> faults_;
};

void CheckVolume(const Config& config, Check& check) {
  if (config.volume.starts_with("builtin:")) {
    check.Try("volume.source", [&] { CheckBuiltinSource(config.volume); });
  } else {
    check.Readable("volume.source", config.volume);
  }
  if (config.isovalue && config.normalized_isovalue) {
    check.Fault("volume.normalized_isovalue", "must not be given together with volume.isovalue");
  }
  const double share = config.normalized_isovalue.value_or(0.5);
  if (!(share >= 0.0 && share <= 1.0)) {
    check.Fault("volume.normalized_isovalue", "must be from 0 to 1");
  }
}

void CheckDevice(const Config& config, Check& check) {
  check.Readable("device.falcon_firmware", config.device.falcon_firmware);
  check.Try("device.kind", [&] {
    const auto device = MakeDevice(config.device, config.realtime.priority - 1);
    check.Try("device.stop_buttons", [&] { StopButtons(config.device, device->spec()); });
    if (IsHardware(device->spec()) && !IsSafe(config.method)) {
      check.Fault("haptics.method", "must be \"tpbcc\" or \"bcc\" with real hardware");
    }
  });
}

void CheckServer(const Config& config, Check& check) {
  check.Try("server.socket", [&] {
    if (!config.socket_path.empty()) UnixTarget(config.socket_path);
  });
  check.Try("server.listen", [&] {
    if (config.listen) CheckListen(*config.listen, config.security);
  });
  if (config.realtime.cpu >= sysconf(_SC_NPROCESSORS_CONF)) {
    check.Fault("realtime.cpu", "is no core of this machine");
  }
}

}  // namespace

std::vector<ConfigFault> CheckConfig(const Config& config, const ConfigKeys& keys) {
  Check check(keys);
  CheckVolume(config, check);
  CheckDevice(config, check);
  CheckServer(config, check);
  return check.Take();
}

int CheckConfigFile(const std::filesystem::path& file, const std::function<void(Config&)>& merge) {
  Config config;
  ConfigReading reading;
  if (!file.empty()) reading = ReadConfig(file, config);
  try {
    merge(config);
  } catch (const Error& error) {
    reading.faults.push_back({"", 0, error.what()});
  }
  const std::string name = file.empty() ? "palpated" : file.string();
  for (ConfigFault& fault : CheckConfig(config, reading.keys)) {
    reading.faults.push_back(std::move(fault));
  }
  for (const ConfigFault& fault : reading.faults) {
    std::fprintf(stderr, "%s\n", ToText(name, fault).c_str());
  }
  if (!reading.faults.empty()) return ExitCode(ErrorKind::kInvalidArgument);
  std::printf("%s: ok\n", name.c_str());
  return 0;
}

}  // namespace palpate
