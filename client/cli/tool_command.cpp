#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/output.h"
#include "client/cli/progress.h"
#include "client/sdk/words.h"
#include "common/error/error.h"
#include "common/error/one_line.h"
#include "common/felt_tool/tool_file.h"
#include "common/files/text_file.h"

namespace palpate::cli {
namespace {

constexpr std::chrono::milliseconds kToolLook{100};
// Of a tool of 64 balls with long comments. A longer one would take seconds to parse.
constexpr std::size_t kMostToolBytes = 256 << 10;
constexpr char kOurTools[] = "share/palpate/tools";

struct ToolValues {
  std::string action;
  std::string file;
};

// The tools that come with this program.
std::filesystem::path OurTool(const std::string& name) {
  std::error_code unknown;
  const auto program = std::filesystem::read_symlink("/proc/self/exe", unknown);
  return program.parent_path().parent_path() / kOurTools / (name + ".toml");
}

HeldTool Read(const std::string& name) {
  const bool is_name = name.find('/') == std::string::npos && !name.ends_with(".toml");
  const std::filesystem::path path = is_name ? OurTool(name) : std::filesystem::path(name);
  if (is_name && !std::filesystem::exists(path)) {
    throw Error(ErrorKind::kNotFound,
                fmt::format("there is no tool '{}' in {}; for a file of your own give its name "
                            "with .toml",
                            name, path.parent_path().string()));
  }
  return ParseTool(ReadTextFile(path, kMostToolBytes), path.filename().string());
}

void Print(const client::Settings& settings, bool json) {
  WriteOutput(json ? ToText(ToJson(settings.tool))
                   : fmt::format("{}{}\n", Describe(settings.tool), OfReplay(settings.replayed)));
}

// Returns when the tool is felt: the fields of its radii are made in the background.
client::Settings WaitUntilFelt(client::Calls& palpated, const client::Settings& asked) {
  client::Settings now = asked;
  WithProgress([&](const client::ProgressFunction& progress) {
    while (now.ball.is_awaited && now.tool == asked.tool) {
      if (!progress({.stage = "making the fields of the tool's balls",
                     .fraction = now.ball.share_done.value_or(0.0)})) {
        throw Error(ErrorKind::kCancelled, "it goes on; the tool is felt when they are made");
      }
      std::this_thread::sleep_for(kToolLook);
      now = palpated.GetSettings();
    }
  });
  RequireLive(now);
  if (!(now.tool == asked.tool)) {
    throw Error(ErrorKind::kConflict, "somebody else has taken another tool");
  }
  if (!now.ball.problem.empty()) throw Error(ErrorKind::kTooLarge, client::BallInWords(now));
  return now;
}

void Take(client::Calls& palpated, const HeldTool& tool, bool json) {
  client::SettingsUpdate update;
  update.tool = tool;
  const client::SettingsResult result = palpated.Set(update);
  PrintNotKept(result.not_kept);
  Print(WaitUntilFelt(palpated, result.settings), json);
}

}  // namespace

std::string Describe(const HeldTool& tool) {
  if (tool.ball.empty()) return "no tool: the stylus's tip is felt";
  const auto carving = std::ranges::count_if(tool.ball, &HeldToolBall::carves);
  double least_mm = tool.ball.front().radius_mm, most_mm = least_mm, length_mm = 0.0;
  for (const HeldToolBall& ball : tool.ball) {
    least_mm = std::min(least_mm, ball.radius_mm);
    most_mm = std::max(most_mm, ball.radius_mm);
    length_mm = std::max(length_mm, ball.center_mm.norm() + ball.radius_mm);
  }
  const std::string radii = least_mm == most_mm ? fmt::format("{:g} mm", least_mm)
                                                : fmt::format("{:g} to {:g} mm", least_mm, most_mm);
  return fmt::format("tool {}: {} balls of radius {}, up to {:g} mm from the tip{}",
                     tool.name.empty() ? "without a name" : OneLine(tool.name), tool.ball.size(),
                     radii, length_mm, carving > 0 ? fmt::format("; {} carve", carving) : "");
}

void AddTool(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command = app.add_subcommand(
      "tool", "Takes a rigid tool into the hand, such as a drill with its shaft");
  SetFooter(*command,
            "The tool is felt with all of its balls, by force, and by torque on a device that has\n"
            "it. A FILE is TOML; deploy/guides/tools.md says what is in it. probe, drill and\n"
            "endoscope come with this program.\n"
            "Examples: palpate tool load drill\n"
            "          palpate tool load my-tool.toml\n"
            "          palpate tool none              (the stylus's tip again)\n"
            "          palpate tool                   (which tool it is)");
  const auto values = std::make_shared<ToolValues>();
  command->add_option("action", values->action, "load, or none; without it the tool is shown")
      ->option_text("load|none")
      ->suggest({"load", "none"});
  command->add_option("file", values->file, "A tool's name, or a file of it")
      ->option_text("NAME|FILE")
      ->suggest({"probe", "drill", "endoscope"});
  AddJson(*command, invocation);
  command->callback([&invocation, values] {
    const bool loads = values->action == "load";
    if (!loads && !values->action.empty() && values->action != "none") {
      throw arguments::UsageError("give load FILE, or none");
    }
    if (loads == values->file.empty()) throw arguments::UsageError("give load FILE, or none");
    // What cannot be read is told before a daemon is asked.
    const HeldTool tool = loads ? Read(values->file) : HeldTool();
    invocation.command = [values, tool, &invocation](client::Calls& palpated) {
      if (values->action.empty()) return Print(palpated.GetSettings(), invocation.json);
      Take(palpated, tool, invocation.json);
    };
  });
}

}  // namespace palpate::cli
