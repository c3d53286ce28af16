#include "client/cli/record_command.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <cstdint>
#include <ctime>
#include <memory>
#include <optional>
#include <thread>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/output.h"
#include "client/cli/paths_there.h"
#include "client/program/interrupt.h"
#include "client/sdk/words.h"
#include "common/error/text.h"

namespace palpate::cli {
namespace {

constexpr std::chrono::milliseconds kPollPeriod(50);
constexpr std::chrono::milliseconds kShowPeriod(500);
constexpr const char* kFileHelp = "File on the daemon's machine";

struct RecordOptions {
  std::string path;  // relative to the working directory, or absolute
  bool overwrite = false;
  std::optional<double> seconds;
};
using RecordOptionsPtr = std::shared_ptr<RecordOptions>;

client::RecordingState Start(client::Calls& palpated, const RecordOptions& options) {
  return palpated.StartRecording(PathThere(palpated, options.path), options.overwrite);
}

void ThrowIfEndedEarly(const client::RecordingState& state) {
  if (state.error.empty()) return;
  throw Error(state.disk_full ? ErrorKind::kDiskFull : ErrorKind::kFailedPrecondition,
              "the recording ended early: " + state.error + "; what it has is kept");
}

void WarnOfLeftOut(const client::RecordingState& state) {
  if (!state.left_out.empty()) fmt::print(stderr, "palpate: {}\n", OneLine(state.left_out));
}

// Waits until the time is over, a signal comes, or the recording ends by itself.
void Await(client::Calls& palpated, const RecordOptions& options) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point start = Clock::now();
  Clock::time_point show_at = start;
  StatusLine line;
  while (!Interrupt::IsRaised()) {
    const std::chrono::duration<double> since = Clock::now() - start;
    if (options.seconds && since.count() >= *options.seconds) return;
    if (Clock::now() >= show_at) {
      const client::RecordingState state = palpated.GetRecording();
      if (!state.running) return;
      line.Show("recording: " + DescribeRecording(state));
      show_at += kShowPeriod;
    }
    std::this_thread::sleep_for(kPollPeriod);
  }
}

// Records until the seconds are over, a signal comes, or our output is closed.
void Run(client::Calls& palpated, const RecordOptions& options) {
  const Interrupt interrupt;
  WarnOfLeftOut(Start(palpated, options));
  try {
    Await(palpated, options);
  } catch (...) {
    // After any error on our side, the recording must still be stopped.
    try {
      palpated.StopRecording();
    } catch (const Error&) {
    }
    throw;
  }
  const client::RecordingState state = palpated.StopRecording();
  WriteOutput("recorded " + DescribeRecording(state) + "\n");
  WarnOfLeftOut(state);
  ThrowIfEndedEarly(state);
}

void Stop(client::Calls& palpated, bool json) {
  const client::RecordingState state = palpated.StopRecording();
  WriteOutput(json ? ToText(ToJson(state)) : "recorded " + DescribeRecording(state) + "\n");
  WarnOfLeftOut(state);
  ThrowIfEndedEarly(state);
}

void Show(client::Calls& palpated, bool json) {
  const client::RecordingState state = palpated.GetRecording();
  const std::string what = state.path.empty() ? "" : DescribeRecording(state);
  WriteOutput(json            ? ToText(ToJson(state))
              : state.running ? "recording: " + what + "\n"
              : what.empty()  ? "not recording\n"
                              : "not recording; the last: " + what + "\n");
  if (!json && state.replay) WriteOutput(DescribeReplay(state.replay));
  WarnOfLeftOut(state);
  if (!state.running) ThrowIfEndedEarly(state);
}

std::string TimeText(std::uint64_t ticks) {
  return fmt::format("{:.3f} s", static_cast<double>(ticks) * 1e-3);
}

void List(client::Calls& palpated, bool json) {
  const client::RecordingList list = palpated.ListRecordings();
  std::string text;
  for (const client::RecordedFile& file : list.recordings) {
    text += fmt::format("{:%Y-%m-%d %H:%M}  {:8.1f} MB  {}\n",
                        fmt::localtime(static_cast<std::time_t>(file.modified_s)),
                        static_cast<double>(file.size_bytes) * 1e-6, OneLine(file.path));
  }
  WriteOutput(json ? ToText(ToJson(list)) : text.empty() ? "no recordings\n" : text);
}

void Replay(client::Calls& palpated, const std::string& path,
            const client::ReplayOptions& options) {
  const Interrupt interrupt;
  client::ReplayState last;
  {
    StatusLine line;
    last = palpated.Replay(
        PathThere(palpated, path), options, [&line](const client::ReplayState& state) {
          if (!state.marker.empty()) {
            line.Clear();
            WriteOutput(TimeText(state.ticks) + ": " + OneLine(state.marker) + "\n");
          }
          line.Show(fmt::format("replaying: {} of {}, {} ticks lost", TimeText(state.ticks),
                                TimeText(state.total_ticks), state.lost_ticks));
          return !Interrupt::IsRaised();
        });
  }
  WriteOutput(fmt::format("replayed {} ticks, {} lost\n", last.ticks - options.first_tick,
                          last.lost_ticks));
}

arguments::Command* AddFileCommand(arguments::Command& record, const char* name,
                                   const char* description, RecordOptions& options) {
  arguments::Command* command = record.add_subcommand(name, description);
  command->add_option("file", options.path, kFileHelp)->required()->option_text("FILE");
  command->add_flag("--overwrite", options.overwrite, "Replace the file if it is there");
  return command;
}

void AddRunAndStart(arguments::Command& record, Invocation& invocation) {
  const auto options = std::make_shared<RecordOptions>();
  arguments::Command* run =
      AddFileCommand(record, "run", "Records until Ctrl-C, then shows a summary", *options);
  SetFooter(*run, "Example: palpate record run trial-7.mcap --seconds 60");
  run->add_option("--seconds", options->seconds, "End after this time, s [default: none]")
      ->check(arguments::Positive());
  run->callback([&invocation, options] {
    invocation.command = [options](client::Calls& palpated) { Run(palpated, *options); };
  });
  arguments::Command* start =
      AddFileCommand(record, "start", "Starts recording and returns", *options);
  SetFooter(*start, "Example: palpate record start trial-7.mcap");
  start->callback([&invocation, options] {
    invocation.command = [options](client::Calls& palpated) {
      const client::RecordingState state = Start(palpated, *options);
      WriteOutput("recording to " + OneLine(state.path) + "\n");
      WarnOfLeftOut(state);
    };
  });
}

}  // namespace

void AddRecord(arguments::Command& app, Invocation& invocation) {
  arguments::Command* record = app.add_subcommand(
      "record",
      "Records every tick of the haptic loop, and what changes settings and voxels.\n"
      "`palpate-lab replay --recording FILE` computes a recording again, bit for bit;\n"
      "`palpate-lab export FILE` makes a table of it.");
  record->require_subcommand(1);
  AddRunAndStart(*record, invocation);
  arguments::Command* stop =
      record->add_subcommand("stop", "Ends the recording and shows a summary");
  SetFooter(*stop, "Example: palpate record stop --json");
  AddJson(*stop, invocation);
  stop->callback([&invocation] {
    invocation.command = [&invocation](auto& palpated) { Stop(palpated, invocation.json); };
  });
  arguments::Command* status = record->add_subcommand("status", "Shows the state of the recording");
  SetFooter(*status, "Example: palpate record status --json | jq .lost_ticks");
  AddJson(*status, invocation);
  status->callback([&invocation] {
    invocation.command = [&invocation](auto& palpated) { Show(palpated, invocation.json); };
  });
  arguments::Command* list = record->add_subcommand(
      "list", "Shows the recordings in the folders that palpated saves to, newest first");
  SetFooter(*list, "Example: palpate record list --json | jq -r '.recordings[0].path'");
  AddJson(*list, invocation);
  list->callback([&invocation] {
    invocation.command = [&invocation](auto& palpated) { List(palpated, invocation.json); };
  });
}

void AddMark(arguments::Command& app, Invocation& invocation) {
  arguments::Command* command = app.add_subcommand(
      "mark", "Puts a marker with the time of the call into the recording that runs");
  SetFooter(*command, "Example: palpate mark 'trial 7 begins'");
  const auto text = std::make_shared<std::string>();
  command->add_option("text", *text, "What happened")->required()->option_text("TEXT");
  command->callback([&invocation, text] {
    invocation.command = [text](client::Calls& palpated) {
      WriteOutput(fmt::format("marked at {} ns\n", palpated.Mark(*text)));
    };
  });
}

void AddReplay(arguments::Command& app, Invocation& invocation) {
  struct Values {
    std::string path;
    double speed = 1.0;
    double from_s = 0.0;
  };
  arguments::Command* command = app.add_subcommand(
      "replay",
      "Plays a recording to all clients that watch, with forces off. The recorded volume must\n"
      "be loaded. At the end, settings and voxels are again as before. Ctrl-C ends it, with\n"
      "exit code 9.");
  SetFooter(*command, "Example: palpate replay trial-7.mcap --speed 0.25");
  const auto values = std::make_shared<Values>();
  command->add_option("file", values->path, kFileHelp)->required()->option_text("FILE");
  command->add_option("--speed", values->speed, "Multiple of real time, up to 100")
      ->check(arguments::Positive(100.0))
      ->capture_default_str();
  command
      ->add_option("--from", values->from_s,
                   "Begin here, s of the recording; what changed before is applied at once")
      ->check(arguments::NonNegativeNumber())
      ->capture_default_str();
  command->callback([&invocation, values] {
    invocation.command = [values](client::Calls& palpated) {
      const auto first_tick = static_cast<std::uint64_t>(std::llround(values->from_s * 1e3));
      Replay(palpated, values->path, {.speed = values->speed, .first_tick = first_tick});
    };
  });
}

std::string DescribeRecording(const client::RecordingState& state) {
  const auto ticks = static_cast<double>(state.ticks);
  const auto bytes = static_cast<double>(state.size_bytes);
  std::string text = fmt::format("{} ticks ({:.1f} s), {} lost, {:.1f} MB", state.ticks,
                                 ticks * 1e-3, state.lost_ticks, bytes * 1e-6);
  if (state.ticks > 0) text += fmt::format(", {:.0f} bytes per tick", bytes / ticks);
  return text + ", to " + OneLine(state.path);
}

std::string DescribeReplay(const std::optional<client::RunningReplay>& replay) {
  std::string text;
  AppendLine(text, "shows", replay ? client::InWords(replay) : "live");
  if (replay) {
    AppendLine(text, "",
               fmt::format("{} of {}, {}", TimeText(replay->ticks), TimeText(replay->total_ticks),
                           client::IsPaused(*replay)
                               ? "paused"
                               : fmt::format("{:g} times real time", replay->speed)));
  }
  return text;
}

}  // namespace palpate::cli
