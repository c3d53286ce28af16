#include <fmt/core.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/load_command.h"
#include "client/cli/output.h"
#include "client/cli/paths_there.h"
#include "client/cli/progress.h"

namespace palpate::cli {
namespace {

// applied_tick: of a change.
using AppliedTick = std::optional<std::uint64_t>;

Json SeriesJson(const client::SeriesState& series, AppliedTick applied_tick) {
  Json object = ToJson(series);
  if (applied_tick) object["applied_tick"] = *applied_tick;
  return object;
}

std::string DescribeSeries(const client::SeriesState& series, AppliedTick applied_tick) {
  std::string text = fmt::format(
      "{:<10}frame {:.6g} of 0 to {}, {} at {:g} frames/s{}{}; {:.1f} MiB{}\n", "series",
      series.position_frames, series.frames > 0 ? series.frames - 1 : 0,
      series.playing ? "playing" : "paused", series.rate_hz, series.loop ? ", in a loop" : "",
      series.interpolate ? ", interpolated" : "",
      static_cast<double>(series.memory_bytes) / (1024.0 * 1024.0), OfReplay(series.replayed));
  if (applied_tick) {
    text += fmt::format("applied at tick {}, volume revision {}\n", *applied_tick,
                        series.volume_revision);
  }
  return text;
}

void PrintSeries(const client::SeriesState& series, AppliedTick applied_tick, bool json) {
  WriteOutput(json ? ToText(SeriesJson(series, applied_tick))
                   : DescribeSeries(series, applied_tick));
}

struct SeriesValues {
  std::vector<std::string> files;
  LoadValues load;
  double number = 0.0;
  std::string on_or_off;
};
using SeriesValuesPtr = std::shared_ptr<SeriesValues>;

void Load(client::Calls& palpated, const SeriesValues& values) {
  std::vector<std::string> sources;
  for (const std::string& file : values.files) sources.push_back(SourceThere(palpated, file));
  const client::SeriesResult result = WithProgress([&](const auto& progress) {
    return palpated.LoadSeries(sources, OptionsOf(values.load), progress);
  });
  PrintWarnings(result.volume);
  WriteOutput(Describe(result.volume) + DescribeSeries(result.series, result.applied_tick));
}

void AddSeriesLoad(arguments::Command& series, Invocation& invocation,
                   const SeriesValuesPtr& values) {
  arguments::Command* command = series.add_subcommand(
      "load",
      "Loads all frames, replaces the volume by the first and pauses there. The volume felt so\n"
      "far stays until then, and when loading fails. Ctrl-C cancels, with exit code 9.");
  SetFooter(*command,
            "Examples: palpate series load t1.nrrd t2.nrrd t3.nrrd\n"
            "          palpate series load '/data/run7/t*.nrrd' --isovalue 35\n"
            "          palpate series load functional.nii");
  command
      ->add_option("files", values->files,
                   "Files of one frame each, in the order of time, or one file with several, on\n"
                   "the daemon's machine. In quotes a name may be a pattern with * and ?: its\n"
                   "matches come in the order of the numbers in their names.")
      ->required()
      ->option_text("FILES");
  AddVolumeOptions(*command, values->load);
  command->callback([&invocation, values] {
    invocation.command = [values](client::Calls& palpated) { Load(palpated, *values); };
  });
}

// Adds a command that changes how the series plays.
arguments::Command* AddControl(arguments::Command& series, Invocation& invocation,
                               const std::string& name, const std::string& about,
                               const std::string& example,
                               const std::function<client::SeriesControl()>& control) {
  arguments::Command* command = series.add_subcommand(name, about);
  SetFooter(*command, "Example: palpate series " + example);
  AddJson(*command, invocation);
  command->callback([&invocation, control] {
    invocation.command = [&invocation, control](client::Calls& palpated) {
      const client::SeriesControlled now = palpated.ControlSeries(control());
      PrintSeries(now.series, now.applied_tick, invocation.json);
    };
  });
  return command;
}

void AddSwitch(arguments::Command& series, Invocation& invocation, const SeriesValuesPtr& values,
               const std::string& name, const std::string& about,
               std::optional<bool> client::SeriesControl::*member) {
  AddControl(series, invocation, name, about, name + " on",
             [values, member] {
               client::SeriesControl control;
               control.*member = values->on_or_off == "on";
               return control;
             })
      ->add_option("on_or_off", values->on_or_off, "on or off")
      ->required()
      ->check(arguments::IsMember({"on", "off"}))
      ->option_text("on|off");
}

void AddControls(arguments::Command& series, Invocation& invocation,
                 const SeriesValuesPtr& values) {
  using Control = client::SeriesControl;
  AddControl(series, invocation, "play", "Plays, from the end again from the beginning", "play",
             [] { return Control{.playing = true}; });
  AddControl(series, invocation, "pause", "Stays at the frame that is shown", "pause",
             [] { return Control{.playing = false}; });
  AddControl(series, invocation, "seek", "Goes to a frame", "seek 2.5",
             [values] { return Control{.position_frames = values->number}; })
      ->add_option("position", values->number,
                   "In frames, 0 the first; between two where the series is interpolated")
      ->required()
      ->check(arguments::Finite())
      ->option_text("N");
  AddControl(series, invocation, "rate", "Sets how fast it plays", "rate -5",
             [values] { return Control{.rate_hz = values->number}; })
      ->add_option("rate_hz", values->number,
                   "Frames per second, negative backwards: -1000 to 1000, not 0")
      ->required()
      ->check(arguments::Finite())
      ->option_text("HZ");
  AddSwitch(series, invocation, values, "loop", "At the end: begin again, or stop there",
            &Control::loop);
  AddSwitch(series, invocation, values, "interpolate", "Blends neighbouring frames in time",
            &Control::interpolate);
}

}  // namespace

void AddSeries(arguments::Command& app, Invocation& invocation) {
  arguments::Command* series =
      app.add_subcommand("series", "A time series under the stylus: load, play, pause, seek");
  SetFooter(*series, "Example: palpate series load 't*.nrrd' && palpate series play");
  series->require_subcommand(1);
  const auto values = std::make_shared<SeriesValues>();
  AddSeriesLoad(*series, invocation, values);
  AddControls(*series, invocation, values);
  arguments::Command* info = series->add_subcommand("info", "Shows what is played, and how");
  SetFooter(*info, "Example: palpate series info --json");
  AddJson(*info, invocation);
  info->callback([&invocation] {
    invocation.command = [&invocation](client::Calls& palpated) {
      PrintSeries(palpated.GetSeries(), std::nullopt, invocation.json);
    };
  });
}

}  // namespace palpate::cli
