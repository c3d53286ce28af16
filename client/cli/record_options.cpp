#include "client/cli/record_options.h"

namespace palpate::cli {
namespace {

constexpr const char* kFileHelp = "File on the daemon's machine";

arguments::Command* AddFileCommand(arguments::Command& record, const char* name,
                                   const char* description, RecordOptions& options) {
  arguments::Command* command = record.add_subcommand(name, description);
  command->add_option("file", options.path, kFileHelp)->required()->option_text("FILE");
  command->add_flag("--overwrite", options.overwrite, "Replace the file if it is there");
  return command;
}

}  // namespace

void AddRecord(arguments::Command& app, Invocation& invocation, RecordValues& values) {
  arguments::Command* record = app.add_subcommand(
      "record",
      "Records every tick of the haptic loop, and what changes settings and voxels.\n"
      "`palpate-lab replay --recording FILE` computes a recording again, bit for bit;\n"
      "`palpate-lab export FILE` makes a table of it.");
  record->require_subcommand(1);
  RecordOptions& options = values.record;

  arguments::Command* run =
      AddFileCommand(*record, "run", "Records until Ctrl-C, then shows a summary", options);
  SetFooter(*run, "Example: palpate record run trial-7.palrec --seconds 60");
  run->add_option("--seconds", options.seconds, "End after this time, s [default: none]")
      ->check(arguments::Positive());
  run->callback([&invocation, &options] {
    invocation.command = [&options](const Connection& c) { RunRecording(c, options); };
  });

  arguments::Command* start =
      AddFileCommand(*record, "start", "Starts recording and returns", options);
  SetFooter(*start, "Example: palpate record start trial-7.palrec");
  start->callback([&invocation, &options] {
    invocation.command = [&options](const Connection& c) { StartRecording(c, options); };
  });

  arguments::Command* stop =
      record->add_subcommand("stop", "Ends the recording and shows a summary");
  SetFooter(*stop, "Example: palpate record stop --json");
  stop->add_flag("--json", options.json, "One JSON object instead of text");
  stop->callback([&invocation, &options] {
    invocation.command = [&options](const Connection& c) { StopRecording(c, options.json); };
  });

  arguments::Command* status =
      record->add_subcommand("status", "Shows whether and what is recorded");
  SetFooter(*status, "Example: palpate record status --json | jq .lost_ticks");
  status->add_flag("--json", options.json, "One JSON object instead of text");
  status->callback([&invocation, &options] {
    invocation.command = [&options](const Connection& c) { ShowRecording(c, options.json); };
  });
}

void AddMark(arguments::Command& app, Invocation& invocation, RecordValues& values) {
  arguments::Command* command = app.add_subcommand(
      "mark", "Puts a marker with the time of the call into the recording that runs");
  SetFooter(*command, "Example: palpate mark 'trial 7 begins'");
  command->add_option("text", values.marker, "What happened")->required()->option_text("TEXT");
  command->callback([&invocation, &values] {
    invocation.command = [&values](const Connection& c) { MarkRecording(c, values.marker); };
  });
}

void AddReplay(arguments::Command& app, Invocation& invocation, RecordValues& values) {
  arguments::Command* command = app.add_subcommand(
      "replay",
      "Plays a recording to all who watch, forces off; the volume that was recorded must be\n"
      "loaded. What was felt before comes back at its end. Ctrl-C ends it, with exit code 9.");
  SetFooter(*command, "Example: palpate replay trial-7.palrec --speed 0.25");
  command->add_option("file", values.replay.path, kFileHelp)->required()->option_text("FILE");
  command->add_option("--speed", values.replay.speed, "Times real time, up to 100")
      ->check(arguments::Positive(100.0))
      ->capture_default_str();
  command->callback([&invocation, &values] {
    invocation.command = [&values](const Connection& c) { Replay(c, values.replay); };
  });
}

}  // namespace palpate::cli
