#include "client/cli/series_options.h"

#include <functional>

#include "client/cli/load_command.h"
#include "client/cli/series_command.h"

namespace palpate::cli {
namespace {

void AddSeriesLoad(arguments::Command& series, Invocation& invocation, SeriesValues& values) {
  arguments::Command* command = series.add_subcommand(
      "load",
      "Loads all frames, replaces the volume by the first and pauses there. The volume felt so\n"
      "far stays until then, and when loading fails. Ctrl-C cancels, with exit code 9.");
  SetFooter(*command,
            "Examples: palpate series load t1.nrrd t2.nrrd t3.nrrd\n"
            "          palpate series load '/data/run7/t*.nrrd' --isovalue 35\n"
            "          palpate series load functional.nii");
  command
      ->add_option("files", values.files,
                   "Files of one frame each, in the order of time, or one file with several, on\n"
                   "the daemon's machine. In quotes a name may be a pattern with * and ?: its\n"
                   "matches come in the order of the numbers in their names.")
      ->required()
      ->option_text("FILES");
  AddVolumeOptions(*command, values.load);
  command->callback([&invocation, &values] {
    v1::LoadSeriesRequest request;
    for (const std::string& file : values.files) request.add_sources(file);
    *request.mutable_options() = RequestOf(values.load);
    invocation.command = [request](const Connection& c) { LoadSeries(c, request); };
  });
}

// A command that changes how the series plays.
arguments::Command* AddControl(arguments::Command& series, Invocation& invocation,
                               const std::string& name, const std::string& about,
                               const std::string& example,
                               const std::function<void(v1::ControlSeriesRequest&)>& fill_in) {
  arguments::Command* command = series.add_subcommand(name, about);
  SetFooter(*command, "Example: palpate series " + example);
  command->add_flag("--json", invocation.json, "One JSON object instead of text");
  command->callback([&invocation, fill_in] {
    v1::ControlSeriesRequest request;
    fill_in(request);
    invocation.command = [request, &invocation](const Connection& c) {
      ControlSeries(c, request, invocation.json);
    };
  });
  return command;
}

void AddSwitch(arguments::Command& series, Invocation& invocation, SeriesValues& values,
               const std::string& name, const std::string& about,
               void (v1::ControlSeriesRequest::*set)(bool)) {
  AddControl(series, invocation, name, about, name + " on",
             [&values, set](v1::ControlSeriesRequest& request) {
               (request.*set)(values.on_or_off == "on");
             })
      ->add_option("on_or_off", values.on_or_off, "on or off")
      ->required()
      ->check(arguments::IsMember({"on", "off"}))
      ->option_text("on|off");
}

}  // namespace

void AddSeries(arguments::Command& app, Invocation& invocation, SeriesValues& values) {
  arguments::Command* series =
      app.add_subcommand("series", "A time series under the stylus: load, play, pause, seek");
  SetFooter(*series, "Example: palpate series load 't*.nrrd' && palpate series play");
  series->require_subcommand(1);
  AddSeriesLoad(*series, invocation, values);
  AddControl(*series, invocation, "play", "Plays, from the end again from the beginning", "play",
             [](v1::ControlSeriesRequest& request) { request.set_playing(true); });
  AddControl(*series, invocation, "pause", "Stays at the frame that is shown", "pause",
             [](v1::ControlSeriesRequest& request) { request.set_playing(false); });
  AddControl(
      *series, invocation, "seek", "Goes to a frame", "seek 2.5",
      [&values](v1::ControlSeriesRequest& request) { request.set_position_frames(values.number); })
      ->add_option("position", values.number,
                   "In frames, 0 the first; between two where the series is interpolated")
      ->required()
      ->check(arguments::Finite())
      ->option_text("N");
  AddControl(*series, invocation, "rate", "Sets how fast it plays", "rate -5",
             [&values](v1::ControlSeriesRequest& request) { request.set_rate_hz(values.number); })
      ->add_option("rate_hz", values.number,
                   "Frames per second, negative backwards: -1000 to 1000, not 0")
      ->required()
      ->check(arguments::Finite())
      ->option_text("HZ");
  AddSwitch(*series, invocation, values, "loop", "At the end: begin again, or stop there",
            &v1::ControlSeriesRequest::set_loop);
  AddSwitch(*series, invocation, values, "interpolate", "Blends neighbouring frames in time",
            &v1::ControlSeriesRequest::set_interpolate);
  arguments::Command* info = series->add_subcommand("info", "Shows what is played, and how");
  SetFooter(*info, "Example: palpate series info --json");
  info->add_flag("--json", invocation.json, "One JSON object instead of text");
  info->callback([&invocation] {
    invocation.command = [&invocation](const Connection& c) { PrintSeries(c, invocation.json); };
  });
}

}  // namespace palpate::cli
