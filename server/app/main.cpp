// palpated: the haptics daemon.
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <CLI/CLI.hpp>

#include <cstdio>

#include "common/error/error.h"
#include "server/app/config.h"
#include "server/app/daemon.h"

namespace palpate {
namespace {

struct Options {
  std::string config_file;
  std::optional<std::string> volume, device, socket, listen, method, state_folder;
  std::optional<double> isovalue, normalized_isovalue, stiffness, damping, scale;
  std::vector<double> spacing_mm;
};

void AddOptions(CLI::App& app, Options& options) {
  app.add_option("--config", options.config_file,
                 "TOML file with the settings below; the command line wins")
      ->check(CLI::ExistingFile);
  app.add_option("--volume", options.volume,
                 "volume file, DICOM folder, or builtin:cylinder, builtin:sphere[:N], "
                 "builtin:bumps[:N], builtin:gyroid[:N] [builtin:bumps]");
  auto* isovalue =
      app.add_option("--isovalue", options.isovalue, "isovalue to start with, in data units");
  app.add_option("--normalized-isovalue", options.normalized_isovalue,
                 "the same over the volume's range, 0 to 1 [0.5]")
      ->excludes(isovalue);
  app.add_option("--spacing-mm", options.spacing_mm,
                 "voxel spacing X,Y,Z in mm instead of the file's")
      ->delimiter(',')
      ->expected(3);
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
  app.add_option("--listen", options.listen, "also listen on this loopback ADDR:PORT");
  app.add_option("--state-folder", options.state_folder,
                 "where volumes' places are kept; empty: nowhere [$STATE_DIRECTORY, "
                 "$XDG_STATE_HOME/palpate or ~/.local/state/palpate]");
  app.set_version_flag("--version", "palpated " PALPATE_VERSION);
}

template <class T, class U>
void Override(const std::optional<T>& from, U& to) {
  if (from) to = *from;
}

Config MakeConfig(const Options& options) {
  Config config;
  if (!options.config_file.empty()) ReadConfigFile(options.config_file, config);
  // A volume on the command line comes without the file's isovalue and spacing.
  if (options.volume) config.spacing_mm.reset();
  if (options.volume || options.isovalue || options.normalized_isovalue) {
    config.isovalue = options.isovalue;
    config.normalized_isovalue = options.normalized_isovalue;
  }
  Override(options.volume, config.volume);
  Override(options.device, config.device.kind);
  Override(options.socket, config.socket_path);
  Override(options.stiffness, config.haptics.stiffness_n_per_mm);
  Override(options.damping, config.haptics.damping_n_s_per_m);
  if (options.state_folder) config.state_folder = options.state_folder;
  if (options.scale) config.device_mm_per_volume_mm = options.scale;
  if (options.listen) config.listen = ParseHostPort(*options.listen);
  if (options.method) config.method = ParseMethod(*options.method);
  if (!options.spacing_mm.empty()) config.spacing_mm = Vec3(options.spacing_mm.data());
  return config;
}

int Run(int argc, char** argv) {
  CLI::App app(
      "palpated: feel an isosurface of a volume with a force-feedback stylus.\n"
      "Runs the 1 kHz haptic loop and serves viewers over gRPC until SIGINT or SIGTERM.");
  app.footer("Example: palpated --volume head.nrrd --isovalue 300");
  Options options;
  AddOptions(app, options);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kUsageExitCode;
  }
  spdlog::set_default_logger(spdlog::stderr_color_mt("palpated"));
  spdlog::set_pattern("%Y-%m-%d %H:%M:%S.%e %^%l%$ %v");
  BlockEndingSignals();
  try {
    RunDaemon(MakeConfig(options));
    return 0;
  } catch (const Error& error) {
    std::fprintf(stderr, "palpated: %s\n", error.what());
    return ExitCode(error.kind());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "palpated: %s\n", error.what());
    return ExitCode(ErrorKind::kInternal);
  }
}

}  // namespace
}  // namespace palpate

int main(int argc, char** argv) { return palpate::Run(argc, argv); }
