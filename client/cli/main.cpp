// palpate: the command line client of palpated. Parses and dispatches.
#include <fmt/core.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <vector>

#include "client/cli/connection.h"
#include "client/cli/device_options.h"
#include "client/cli/doctor_command.h"
#include "client/cli/download_options.h"
#include "client/cli/edit_options.h"
#include "client/cli/info_command.h"
#include "client/cli/invocation.h"
#include "client/cli/load_options.h"
#include "client/cli/output.h"
#include "client/cli/place_options.h"
#include "client/cli/record_options.h"
#include "client/cli/series_options.h"
#include "client/cli/set_command.h"
#include "client/cli/setting.h"
#include "client/cli/upload_options.h"
#include "client/cli/watch_command.h"
#include "client/options/server_options.h"
#include "common/arguments/arguments.h"
#include "common/error/error.h"
#include "common/error/one_line.h"

namespace palpate::cli {
namespace {

void AddInfo(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command =
      app.add_subcommand("info", "Shows the daemon's version, device, servo, volume and settings");
  SetFooter(*command, "Example: palpate info --json | jq .servo.missed_ticks");
  command->add_flag("--json", invocation.json, "One JSON object instead of text");
  command->callback([&invocation] {
    invocation.command = [&invocation](const Connection& c) { PrintInfo(c, invocation.json); };
  });
}

void AddSettings(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command = app.add_subcommand(
      "settings", "Shows all that `set` changes, with units, and the revision of the settings");
  SetFooter(*command, "Example: palpate settings --json");
  command->add_flag("--json", invocation.json, "One JSON object instead of text");
  command->callback([&invocation] {
    invocation.command = [&invocation](const Connection& c) { PrintSettings(c, invocation.json); };
  });
}

void AddWatch(arguments::Command& app, Invocation& invocation, WatchOptions& options) {
  arguments::Command* command = app.add_subcommand(
      "watch",
      "Watches the haptic loop: a live view on a terminal, else a line a second; then a summary.\n"
      "Positions are in the device frame: mm, x right, y up, z towards the user.\n"
      "Ctrl-C ends it, with exit code 0.");
  SetFooter(*command,
            "Examples: palpate watch --seconds 60 > log.txt\n"
            "          palpate watch --json --rate-hz 1000 --count 5000 > ticks.jsonl");
  command
      ->add_option("--rate-hz", options.rate_hz,
                   "Samples per second, above 0, up to 1000 [default: 1000, with --json 60]")
      ->check(arguments::Positive(1000.0));
  command->add_option("--count", options.count, "End after this many samples [default: none]")
      ->check(arguments::Positive());
  command->add_option("--seconds", options.seconds, "End after this time, s [default: none]")
      ->check(arguments::Positive());
  command->add_flag("--json", options.json, "One JSON object per sample and line, no summary");
  command->callback([&invocation, &options] {
    invocation.command = [&options](const Connection& c) { Watch(c, options); };
  });
}

// Where the options of `set` put their values.
struct SetValues {
  SetOptions options;
  std::string key;
  std::string value;
  bool normalized = false;
};

void TakeSetting(SetValues& values) {
  const Setting* setting = FindSetting(values.key);
  if (!setting) throw arguments::UsageError("there is no setting '" + values.key + "'");
  if (values.normalized) {
    if (setting != &client::kIsovalue) {
      throw arguments::UsageError("--normalized is for the isovalue");
    }
    setting = &client::kNormalizedIsovalue;
  }
  if (!StoreSetting(*setting, values.value, values.options.update)) {
    throw arguments::UsageError(
        fmt::format("{} cannot be '{}': give {}", setting->name, values.value, ValuesOf(*setting)));
  }
  values.options.setting = setting;
}

void AddSet(arguments::Command& app, Invocation& invocation, SetValues& values) {
  arguments::Command* command = app.add_subcommand("set", "Changes what is felt, at one tick");
  SetFooter(*command, "KEY, with or without its unit (stiffness, stiffness_n_per_mm):\n" +
                          ListOfSettings() +
                          "Examples: palpate set isovalue -200\n"
                          "          palpate set isovalue --normalized 0.4\n"
                          "          palpate set stiffness 0.8");
  command->add_option("key", values.key, "What to change, see below")
      ->required()
      ->option_text("KEY");
  command->add_option("value", values.value, "Its new value")->required()->option_text("VALUE");
  command->add_flag("--normalized", values.normalized,
                    "The isovalue is given over the volume's range at load, 0 to 1");
  command->add_option("--expected-revision", values.options.update.expected_revision,
                      "Change it only on top of this settings revision, else exit with 7");
  command->add_flag("--json", values.options.json, "One JSON object instead of text");
  command->callback([&invocation, &values] {
    TakeSetting(values);
    invocation.command = [&values](const Connection& c) { ChangeSetting(c, values.options); };
  });
}

// The parser takes -200 for a number, but -.5 for an option.
std::vector<std::string> Arguments(int argc, char** argv) {
  std::vector<std::string> arguments(argv + 1, argv + argc);
  for (std::string& argument : arguments) {
    if (argument.size() > 2 && argument.compare(0, 2, "-.") == 0 && argument[2] >= '0' &&
        argument[2] <= '9') {
      argument.insert(1, "0");
    }
  }
  return arguments;
}

int Fail(const std::string& message, int exit_code) {
  std::fprintf(stderr, "palpate: %s\n", OneLine(message).c_str());
  return exit_code;
}

int Main(int argc, char** argv) {
  Invocation invocation;
  WatchOptions watch;
  SetValues set;
  LoadValues load;
  PlaceValues place;
  DeviceValues device;
  DownloadOptions download;
  RecordValues record;
  LoadValues upload;
  SeriesValues series;
  DoctorValues doctor;
  arguments::Command app(
      "Steers and watches palpated, the daemon that makes a volume's isosurface felt.", "palpate");
  app.footer(
      "Exit codes: 0 done, 2 wrong usage, 3 wrong value, 4 not found, 5 no permission,\n"
      "6 too large, 7 conflict, 8 palpated unavailable, 9 cancelled, 10 something is missing,\n"
      "11 disk full, 1 anything else.\n"
      "Emergency stop: palpate device stop\n"
      "Example: palpate set isovalue 40.8");
  app.set_version_flag("--version", std::string("palpate ") + PALPATE_VERSION);
  app.require_subcommand(1);
  app.fallthrough();
  client::AddServerOptions(app, invocation.server);
  AddInfo(app, invocation);
  AddWatch(app, invocation, watch);
  AddSet(app, invocation, set);
  AddSettings(app, invocation);
  AddLoad(app, invocation, load);
  AddPlace(app, invocation, place);
  AddEdit(app, invocation);
  AddHistory(app, invocation);
  AddSave(app, invocation);
  AddDownload(app, invocation, download);
  AddRecord(app, invocation, record);
  AddMark(app, invocation, record);
  AddReplay(app, invocation, record);
  AddUpload(app, invocation, upload);
  AddSeries(app, invocation, series);
  AddDevice(app, invocation, device);
  AddDoctor(app, doctor);
  try {
    if (!app.parse(Arguments(argc, argv))) return 0;
  } catch (const arguments::UsageError& error) {
    return Fail(std::string(error.what()) + "; see --help", kUsageExitCode);
  }
  const client::Server server = client::Resolve(invocation.server);
  if (doctor.requested) return RunDoctor(server, doctor.json);
  invocation.command(Connection(server));
  return 0;
}

}  // namespace
}  // namespace palpate::cli

int main(int argc, char** argv) {
  // A closed output is an error of write(), not the end of the process.
  std::signal(SIGPIPE, SIG_IGN);
  // Our one line says it; gRPC's own log would only add to it.
  setenv("GRPC_VERBOSITY", "NONE", 0);
  try {
    return palpate::cli::Main(argc, argv);
  } catch (const palpate::cli::OutputClosed&) {
    return 0;
  } catch (const palpate::Error& error) {
    return palpate::cli::Fail(error.what(), palpate::ExitCode(error.kind()));
  } catch (const std::exception& error) {
    return palpate::cli::Fail(std::string("internal error: ") + error.what(),
                              palpate::ExitCode(palpate::ErrorKind::kInternal));
  }
}
