// palpated: the haptics daemon.
#include <fcntl.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <iterator>
#include <string>
#include <system_error>
#include <variant>
#include <vector>

#include "common/arguments/arguments.h"
#include "common/error/error.h"
#include "server/app/config.h"
#include "server/app/config_check.h"
#include "server/app/log.h"
#include "server/app/run.h"
#include "server/app/thread_stacks.h"

namespace palpate {
namespace {

enum class Values { kText, kNumber, kCount, kFlag, kThreeNumbers, kFolders };

// An option that stands in place of a key of the file.
struct KeyOption {
  const char* name;
  const char* key;
  Values values;
  const char* about;
};

constexpr KeyOption kKeyOptions[] = {
    {"volume,--volume", "volume.source", Values::kText,
     "volume file, DICOM folder, or builtin:cylinder, builtin:sphere[:N], builtin:bumps[:N], "
     "builtin:gyroid[:N] [builtin:bumps]"},
    {"--isovalue", "volume.isovalue", Values::kNumber,
     "isovalue to start with, in data units [one that shows something]"},
    {"--normalized-isovalue", "volume.normalized_isovalue", Values::kNumber,
     "isovalue to start with, from 0 to 1 over the volume's range"},
    {"--spacing-mm", "volume.spacing_mm", Values::kThreeNumbers,
     "voxel spacing X,Y,Z in mm instead of the file's"},
    {"--frame", "volume.frame", Values::kCount, "frame of a file with several frames, from 0"},
    {"--grid", "volume.grid", Values::kText, "grid of a .vdb file with several grids"},
    {"--component", "volume.component", Values::kText,
     "for a grid of vectors: magnitude, x, y or z"},
    {"--raw-size", "volume.raw_size", Values::kThreeNumbers,
     "voxels X,Y,Z of a file that holds only voxels, x fastest"},
    {"--raw-type", "volume.raw_type", Values::kText, "type of these voxels, such as uint16"},
    {"--raw-big-endian", "volume.raw_big_endian", Values::kFlag, "order of their bytes"},
    {"--raw-offset-bytes", "volume.raw_offset_bytes", Values::kCount, "where they begin [0]"},
    {"--load-folder", "volume.load_folders", Values::kFolders,
     "folder from which clients may load, with its subfolders; may be given again [the folder in "
     "which palpated is started]"},
    {"--save-folder", "volume.save_folders", Values::kFolders,
     "folder to which clients may save and record, with its subfolders; may be given again [the "
     "folder in which palpated is started]"},
    {"--device-mm-per-volume-mm", "volume.device_mm_per_volume_mm", Values::kNumber,
     "scale of the volume [fits 90 % of the device's workspace]"},
    {"--stiffness-n-per-mm", "haptics.stiffness_n_per_mm", Values::kNumber,
     "force per mm into the surface, 0 to 3 N/mm [0.5]"},
    {"--damping-n-s-per-m", "haptics.damping_n_s_per_m", Values::kNumber,
     "damping along the surface's normal, 0 to 5 N s/m [0]"},
    {"--method", "haptics.method", Values::kText,
     "decomposition of the cells: tpbcc or bcc [tpbcc]"},
    {"--device", "device.kind", Values::kText,
     "haptic device: simulated, replay, omni-firewire, falcon, openhaptics, forcedimension, haply, "
     "or omni-usb, which only identifies the device; see `palpate device list` [simulated]"},
    {"--socket", "server.socket", Values::kText,
     "Unix socket to listen on, for admins; those of lower roles are beside it "
     "[$PALPATE_SOCKET, /run/palpate/palpated.sock, or the user's own]"},
    {"--listen", "server.listen", Values::kText,
     "also listen on this ADDR:PORT; TLS is required unless the address is loopback"},
    {"--state-folder", "state.folder", Values::kText,
     "folder for the places of volumes and the session; empty: none [$STATE_DIRECTORY, "
     "$XDG_STATE_HOME/palpate or ~/.local/state/palpate]"},
    {"--fresh", "state.fresh", Values::kFlag,
     "start as configured: forget the volume and the settings that the last palpated had"},
    {"--log-level", "log.level", Values::kText, "debug, info, warning or error [info]"},
};

struct Options {
  std::string config_file;
  // For each of kKeyOptions, in their order.
  ConfigOverrides values;
  std::vector<arguments::Option*> options;
  bool check_config = false;
  bool log_to_journal = false;
};

template <class T>
arguments::Option* Add(arguments::Command& app, const KeyOption& row, ConfigOverride& to) {
  return app.add_option(row.name, to.value.emplace<T>(), row.about);
}

arguments::Option* Add(arguments::Command& app, const KeyOption& row, ConfigOverride& to) {
  switch (row.values) {
    case Values::kText:
      return Add<std::string>(app, row, to);
    case Values::kNumber:
      return Add<double>(app, row, to);
    case Values::kCount:
      return Add<std::int64_t>(app, row, to);
    case Values::kFlag:
      return app.add_flag(row.name, to.value.emplace<bool>(), row.about);
    case Values::kThreeNumbers:
      return Add<std::vector<double>>(app, row, to)->delimiter(',')->expected(3);
    case Values::kFolders:
      return Add<std::vector<std::string>>(app, row, to)->expected(1)->take_all();
  }
  std::abort();  // no such kind
}

void AddOptions(arguments::Command& app, Options& options) {
  app.add_option("--config", options.config_file,
                 "TOML file with the settings below; the command line wins")
      ->check(arguments::ExistingFile());
  app.add_flag("--check-config", options.check_config,
               "check the configuration, print one line for each fault, and exit (exit code 0: no "
               "fault). Opens no device and loads no volume. Checks whether the user who runs this "
               "can read the files: run it as the daemon's user");
  options.values.resize(std::size(kKeyOptions));
  for (std::size_t n = 0; n < std::size(kKeyOptions); ++n) {
    const std::string name = kKeyOptions[n].name;
    options.values[n].option = name.substr(name.find("--"));
    options.values[n].key = kKeyOptions[n].key;
    options.options.push_back(Add(app, kKeyOptions[n], options.values[n]));
  }
  app.get_option("--normalized-isovalue")->excludes(app.get_option("--isovalue"));
  app.add_flag("--log-to-journal", options.log_to_journal,
               "log with the level prefixes of systemd's journal and without times "
               "[on if stderr is the journal]");
  app.set_version_flag("--version", "palpated " PALPATE_VERSION);
}

// What the command line has given. Its folders may be relative.
ConfigOverrides Given(const Options& options) {
  ConfigOverrides given;
  for (std::size_t n = 0; n < options.options.size(); ++n) {
    if (options.options[n]->count() == 0) continue;
    ConfigOverride& one = given.emplace_back(options.values[n]);
    auto* const folders = std::get_if<std::vector<std::string>>(&one.value);
    if (folders == nullptr) continue;
    for (std::string& folder : *folders) {
      std::error_code error;  // an empty or relative path is refused later
      if (const auto full = std::filesystem::absolute(folder, error); !error) folder = full;
    }
  }
  return given;
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
  const ConfigOverrides given = Given(options);
  const LoadedConfig loaded = LoadConfig(options.config_file, given);
  SetLogLevel(loaded.config.log_level);
  ConfigReader read;
  if (!options.config_file.empty() && !HasTerminal()) {
    read = [&] { return LoadConfig(options.config_file, given, ConfigUse::kReload); };
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
  if (options.check_config) return CheckConfigFile(options.config_file, Given(options));
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
