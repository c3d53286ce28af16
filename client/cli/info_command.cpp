#include <optional>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/isovalues.h"
#include "client/cli/output.h"
#include "client/cli/record_command.h"
#include "common/error/text.h"

namespace palpate::cli {
namespace {

void PrintInfo(client::Calls& palpated, bool json) {
  const client::DaemonInfo daemon = palpated.GetDevice();
  const client::VolumeInfo volume = palpated.GetVolume();
  const client::Settings settings = palpated.GetSettings();
  const std::optional<client::RunningReplay> replay = palpated.GetRecording().replay;
  if (json) {
    Json info = {{"version", daemon.servo.version}, {"server", palpated.name()},
                 {"caller", ToJson(daemon.caller)}, {"device", ToJson(daemon.device)},
                 {"health", ToJson(daemon.health)}, {"forces", ForcesJson(daemon)},
                 {"servo", ToJson(daemon.servo)},   {"volume", ToJson(volume)},
                 {"settings", ToJson(settings)},    {"replay", ToJson(replay)}};
    info["servo"].erase("version");     // it stands above
    info["volume"].erase("histogram");  // 256 lines
    WriteOutput(ToText(info, 2));
    return;
  }
  WriteOutput("palpated " + OneLine(daemon.servo.version) + " at " + palpated.name() + "\n" +
              DescribeCaller(daemon) + DescribeReplay(replay) + Describe(daemon.device) +
              Describe(daemon.health) + DescribeForces(daemon) + Describe(daemon.servo) +
              Describe(volume) + DescribeIsovalues(volume, settings.isovalue) +
              DescribeWarnings(volume) + Describe(settings));
}

void PrintSettings(client::Calls& palpated, bool json) {
  const client::Settings settings = palpated.GetSettings();
  WriteOutput(json ? ToText(ToJson(settings)) : Describe(settings));
}

void Add(arguments::Command& app, Invocation& invocation, const std::string& name,
         const std::string& about, const std::string& footer,
         void (*print)(client::Calls&, bool json)) {
  arguments::Command* command = app.add_subcommand(name, about);
  SetFooter(*command, footer);
  AddJson(*command, invocation);
  command->callback([&invocation, print] {
    invocation.command = [&invocation, print](auto& palpated) { print(palpated, invocation.json); };
  });
}

}  // namespace

void AddInfo(arguments::Command& app, Invocation& invocation) {
  Add(app, invocation, "info",
      "Shows the daemon's version, device, servo, volume and settings, and whether a replay runs",
      "Example: palpate info --json | jq .servo.missed_ticks", PrintInfo);
}

void AddSettings(arguments::Command& app, Invocation& invocation) {
  Add(app, invocation, "settings",
      "Shows all that `set` changes, with units, and the revision of the settings",
      "Example: palpate settings --json", PrintSettings);
}

}  // namespace palpate::cli
