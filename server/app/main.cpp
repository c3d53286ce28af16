// palpated: the haptics daemon.
#include <fcntl.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/arguments/arguments.h"
#include "common/error/error.h"
#include "server/app/config.h"
#include "server/app/config_check.h"
#include "server/app/daemon.h"
#include "server/app/log.h"
#include "server/app/thread_stacks.h"
#include "server/app/token_command.h"

namespace palpate {
namespace {

struct Options {
  std::string config_file;
  std::optional<std::string> volume, device, socket, listen, method, state_folder, log_level;
  std::optional<double> isovalue, normalized_isovalue, stiffness, damping, scale;
  std::vector<double> spacing_mm;
  std::vector<std::string> load_folders, save_folders;
  bool check_config = false;
  bool log_to_journal = false;
};

void AddOptions(arguments::Command& app, Options& options) {
  app.add_option("--config", options.config_file,
                 "TOML file with the settings below; the command line wins")
      ->check(arguments::ExistingFile());
  app.add_flag("--check-config", options.check_config,
               "check the configuration, print one line for each fault, and exit (exit code 0: no "
               "fault). Opens no device and loads no volume. Checks whether the user who runs this "
               "can read the files: run it as the daemon's user");
  app.add_option("volume,--volume", options.volume,
                 "volume file, DICOM folder, or builtin:cylinder, builtin:sphere[:N], "
                 "builtin:bumps[:N], builtin:gyroid[:N] [builtin:bumps]");
  auto* isovalue =
      app.add_option("--isovalue", options.isovalue,
                     "isovalue to start with, in data units [one that shows something]");
  app.add_option("--normalized-isovalue", options.normalized_isovalue,
                 "isovalue to start with, from 0 to 1 over the volume's range")
      ->excludes(isovalue);
  app.add_option("--spacing-mm", options.spacing_mm,
                 "voxel spacing X,Y,Z in mm instead of the file's")
      ->delimiter(',')
      ->expected(3);
  app.add_option("--load-folder", options.load_folders,
                 "folder from which clients may load, with its subfolders; may be given again "
                 "[the folder in which palpated is started]")
      ->expected(1)
      ->take_all();
  app.add_option("--save-folder", options.save_folders,
                 "folder to which clients may save and record, with its subfolders; may be given "
                 "again [the folder in which palpated is started]")
      ->expected(1)
      ->take_all();
  app.add_option("--device-mm-per-volume-mm", options.scale,
                 "scale of the volume [fits 90 % of the device's workspace]");
  app.add_option("--stiffness-n-per-mm", options.stiffness,
                 "force per mm into the surface, 0 to 3 N/mm [0.5]");
  app.add_option("--damping-n-s-per-m", options.damping,
                 "damping along the surface's normal, 0 to 5 N s/m [0]");
  app.add_option("--method", options.method,
                 "decomposition of the cells: tpbcc, bcc, and on the simulated device tptd and "
                 "tpbcc-published [tpbcc]");
  app.add_option("--device", options.device,
                 "haptic device: simulated, replay, omni-usb, falcon, openhaptics; see "
                 "`palpate device list` [simulated]");
  app.add_option("--socket", options.socket,
                 "Unix socket to listen on [$PALPATE_SOCKET, /run/palpate/palpated.sock, or the "
                 "user's own]");
  app.add_option("--listen", options.listen,
                 "also listen on this ADDR:PORT; TLS is required unless the address is loopback");
  app.add_option("--state-folder", options.state_folder,
                 "folder for the places of volumes and the session; empty: none [$STATE_DIRECTORY, "
                 "$XDG_STATE_HOME/palpate or ~/.local/state/palpate]");
  app.add_option("--log-level", options.log_level, "debug, info, warning or error [info]");
  app.add_flag("--log-to-journal", options.log_to_journal,
               "log with the level prefixes of systemd's journal and without times "
               "[on if stderr is the journal]");
  app.set_version_flag("--version", "palpated " PALPATE_VERSION);
}

template <class T, class U>
void Override(const std::optional<T>& from, U& to) {
  if (from) to = *from;
}

void Override(const std::vector<std::string>& from,
              std::optional<std::vector<std::filesystem::path>>& to) {
  if (from.empty()) return;
  to.emplace();
  for (const std::string& folder : from) to->push_back(std::filesystem::absolute(folder));
}

// Puts the command line's values over the file's values.
void Merge(const Options& options, Config& config) {
  // A volume on the command line comes without the file's isovalue, spacing and grid.
  if (options.volume) {
    config.spacing_mm.reset();
    config.grid.clear();
    config.component.clear();
  }
  if (options.volume || options.isovalue || options.normalized_isovalue) {
    config.isovalue = options.isovalue;
    config.normalized_isovalue = options.normalized_isovalue;
  }
  Override(options.volume, config.volume);
  Override(options.device, config.device.kind);
  Override(options.socket, config.socket_path);
  Override(options.stiffness, config.haptics.stiffness_n_per_mm);
  Override(options.damping, config.haptics.damping_n_s_per_m);
  Override(options.log_level, config.log_level);
  if (options.state_folder) config.state_folder = options.state_folder;
  if (options.scale) config.device_mm_per_volume_mm = options.scale;
  if (options.listen) config.listen = ParseHostPort(*options.listen);
  if (options.method) config.method = ParseMethod(*options.method);
  Override(options.load_folders, config.load_folders);
  Override(options.save_folders, config.save_folders);
  if (!options.spacing_mm.empty()) config.spacing_mm = Vec3(options.spacing_mm.data());
}

// Removes the keys that the command line overrides: a change of these keys in the file has no
// effect.
void EraseOverridden(const Options& options, ConfigKeys& keys) {
  const auto erase = [&keys](bool overridden, const char* key) {
    if (overridden) keys.erase(key);
  };
  const bool isovalue = options.volume || options.isovalue || options.normalized_isovalue;
  erase(isovalue, "volume.isovalue");
  erase(isovalue, "volume.normalized_isovalue");
  erase(options.volume || !options.spacing_mm.empty(), "volume.spacing_mm");
  for (const char* key : {"volume.source", "volume.grid", "volume.component"}) {
    erase(options.volume.has_value(), key);
  }
  erase(options.scale.has_value(), "volume.device_mm_per_volume_mm");
  erase(options.device.has_value(), "device.kind");
  erase(options.socket.has_value(), "server.socket");
  erase(options.listen.has_value(), "server.listen");
  erase(options.stiffness.has_value(), "haptics.stiffness_n_per_mm");
  erase(options.damping.has_value(), "haptics.damping_n_s_per_m");
  erase(options.method.has_value(), "haptics.method");
  erase(options.state_folder.has_value(), "state.folder");
  erase(!options.load_folders.empty(), "volume.load_folders");
  erase(!options.save_folders.empty(), "volume.save_folders");
  erase(options.log_level.has_value(), "log.level");
}

ConfigMerge MergeOf(const Options& options) {
  return [&options](LoadedConfig& loaded) {
    EraseOverridden(options, loaded.keys);
    Merge(options, loaded.config);
  };
}

// SIGHUP ends a program in a terminal that hangs up. A service has no terminal; for a service
// SIGHUP means to read the configuration again.
bool HasTerminal() {
  const int terminal = open("/dev/tty", O_RDONLY | O_NOCTTY | O_CLOEXEC);
  if (terminal >= 0) close(terminal);
  return terminal >= 0;
}

// This process holds tokens, keys and volumes in memory. Other processes of the same account must
// not read them, and a crash must leave no core file.
void KeepMemoryPrivate() {
#ifndef PALPATE_SANITIZED
  // Not in sanitizer builds: the leak checker attaches to its own process as a debugger does.
  prctl(PR_SET_DUMPABLE, 0, 0, 0, 0);
#endif
}

void Run(const Options& options) {
  KeepMemoryPrivate();
  const SmallThreadStacks stacks;
  const LoadedConfig loaded = LoadConfig(options.config_file, MergeOf(options));
  SetLogLevel(loaded.config.log_level);
  ConfigReader read;
  if (!options.config_file.empty() && !HasTerminal()) {
    read = [&] { return LoadConfig(options.config_file, MergeOf(options), ConfigUse::kReload); };
  }
  RunDaemon(loaded, read);
}

// Prints one line each, with the journal's prefix for errors if `to_journal`.
int Fail(bool to_journal, const std::vector<std::string>& lines, ErrorKind kind) {
  for (const std::string& line : lines) {
    std::fprintf(stderr, "%spalpated: %s\n", to_journal ? "<3>" : "", line.c_str());
  }
  return ExitCode(kind);
}

int Main(int argc, char** argv) {
  arguments::Command app(
      "palpated: feel an isosurface of a volume with a force-feedback stylus.\n"
      "Runs the 1 kHz haptic loop and serves viewers over gRPC until SIGINT or SIGTERM.");
  app.footer("Example: palpated --volume head.nrrd --isovalue 300");
  Options options;
  AddOptions(app, options);
  std::function<void()> token_command;
  AddTokenCommands(app, token_command);
  try {
    if (!app.parse(argc, argv)) return 0;
  } catch (const arguments::UsageError& error) {
    app.explain(error);
    return kUsageExitCode;
  }
  if (options.check_config) {
    return CheckConfigFile(options.config_file, MergeOf(options));
  }
  const bool to_journal = options.log_to_journal || StderrIsJournal();
  try {
    if (token_command) {
      token_command();
      return 0;
    }
    SetUpLog(to_journal);
    BlockSignals();
    Run(options);
    return 0;
  } catch (const ConfigError& error) {
    return Fail(to_journal, error.lines(), error.kind());
  } catch (const Error& error) {
    return Fail(to_journal, {error.what()}, error.kind());
  } catch (const std::exception& error) {
    return Fail(to_journal, {error.what()}, ErrorKind::kInternal);
  }
}

}  // namespace
}  // namespace palpate

int main(int argc, char** argv) { return palpate::Main(argc, argv); }
