// `palpate tool`.
#include <fmt/core.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/output.h"
#include "client/cli/set_command.h"
#include "client/sdk/words.h"
#include "common/error/error.h"
#include "common/felt_tool/tool_file.h"
#include "common/felt_tool/tool_size.h"

namespace palpate::cli {
namespace {

struct ToolValues {
  std::string action;
  std::string file;
  std::optional<double> scale;
};

// What does not fit here, with the commands that make it fit; `name`: how it was loaded.
std::string FitInWords(const HeldTool& tool, const std::string& name, double scale,
                       const client::Placement& place) {
  const double voxel_mm = place.device_mm_per_voxel;
  const auto fitting = FittingScale(tool, voxel_mm);
  const auto magnification = FittingMagnification(Scaled(tool, scale), voxel_mm);
  std::string ways;
  if (fitting && !name.empty())
    ways = fmt::format("palpate tool load {} --scale {:g}", name, *fitting);
  if (magnification) {
    ways += fmt::format("{}palpate place --scale-by {:g}", ways.empty() ? "" : "', or '",
                        *magnification);
  }
  return ways.empty() ? "no scale makes its balls fit" : "do '" + ways + "'";
}

// Throws `refusal` with what to do.
[[noreturn]] void SayHowToFit(client::Calls& palpated, const Error& refusal, const HeldTool& tool,
                              const ToolValues& values) {
  const double scale = values.scale.value_or(1.0);
  const client::Placement place = palpated.GetPlacement().registration;
  if (refusal.kind() != ErrorKind::kInvalidArgument ||
      FittingScale(Scaled(tool, scale), place.device_mm_per_voxel) == 1.0) {
    throw refusal;
  }
  throw Error(refusal.kind(),
              fmt::format("{}: {}", refusal.what(), FitInWords(tool, values.file, scale, place)));
}

void PrintTool(client::Calls& palpated, const client::Settings& settings, bool json) {
  if (json) return WriteOutput(ToText(ToJson(settings.tool)));
  std::string text = InWords(settings.tool);
  if (!settings.tool.ball.empty()) {
    text += "; " + SizeInVolume(settings.tool,
                                palpated.GetPlacement().registration.device_mm_per_volume_mm);
  } else if (settings.ball.felt_radius_mm > 0.0) {
    text = fmt::format("no tool: a ball of {:g} mm at the stylus's tip is felt",
                       settings.ball.felt_radius_mm);
  }
  const std::string tip = TipInWords(palpated, settings);
  WriteOutput(
      fmt::format("{}{}{}\n", text, tip.empty() ? "" : "; " + tip, OfReplay(settings.replayed)));
}

void Take(client::Calls& palpated, const HeldTool& tool, const ToolValues& values, bool json) {
  client::SettingsUpdate update;
  update.tool = values.scale ? Scaled(tool, *values.scale) : tool;
  client::SettingsResult result;
  try {
    result = SetOrSayHow(palpated, update);
  } catch (const Error& refusal) {
    SayHowToFit(palpated, refusal, tool, values);
  }
  PrintNotKept(result.not_kept);
  const client::Settings felt = WaitForTip(palpated, result.settings);
  if (!felt.ball.problem.empty()) throw Error(ErrorKind::kTooLarge, client::BallInWords(felt));
  PrintTool(palpated, felt, json);
}

}  // namespace

std::string TipInWords(client::Calls& palpated, const client::Settings& settings) {
  std::string text = client::BallInWords(settings);
  if (settings.tool.ball.empty() || settings.ball.problem.empty()) return text;
  const client::Placement place = palpated.GetPlacement().registration;
  if (FittingScale(settings.tool, place.device_mm_per_voxel) == 1.0) return text;
  // One of our tools as it comes can be loaded again; of others the file is not known here.
  std::string name;
  for (const OurTool& tool : OurTools()) {
    if (ParseTool(tool.text, tool.name) == settings.tool) name = tool.name;
  }
  return text + ": " + FitInWords(settings.tool, name, 1.0, place);
}

void AddTool(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command = app.add_subcommand(
      "tool", "Takes a rigid tool into the hand, such as a drill with its shaft");
  SetFooter(*command,
            "The tool is felt with all of its balls, by force, and by torque on a device that has\n"
            "it. A FILE is TOML; deploy/guides/tools.md says what is in it. probe, drill and\n"
            "endoscope come with this program.\n"
            "Examples: palpate tool load drill\n"
            "          palpate tool load drill --scale 0.6   (all its lengths, for small voxels)\n"
            "          palpate tool load my-tool.toml\n"
            "          palpate tool none              (the stylus's tip again)\n"
            "          palpate tool                   (which tool it is)");
  const auto values = std::make_shared<ToolValues>();
  command->add_option("action", values->action, "load, or none; without it the tool is shown")
      ->option_text("load|none")
      ->suggest({"load", "none"});
  std::vector<std::string> names;
  for (const OurTool& tool : OurTools()) names.emplace_back(tool.name);
  command->add_option("file", values->file, "A tool's name, or a file of it")
      ->option_text("NAME|FILE")
      ->suggest(names);
  command->add_option("--scale", values->scale, "All lengths of the tool times this")
      ->check(arguments::PositiveNumber())
      ->option_text("X");
  AddJson(*command, invocation);
  command->callback([&invocation, values] {
    const bool loads = values->action == "load";
    if (!loads && !values->action.empty() && values->action != "none") {
      throw arguments::UsageError("give load FILE, or none");
    }
    if (loads == values->file.empty()) throw arguments::UsageError("give load FILE, or none");
    // What cannot be read is told before a daemon is asked.
    const HeldTool tool = loads ? ReadTool(values->file) : HeldTool();
    invocation.command = [values, tool, &invocation](client::Calls& palpated) {
      if (values->action.empty()) {
        return PrintTool(palpated, palpated.GetSettings(), invocation.json);
      }
      Take(palpated, tool, *values, invocation.json);
    };
  });
}

}  // namespace palpate::cli
