#include "client/cli/record_command.h"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <stop_token>
#include <thread>

#include "client/cli/connection.h"
#include "client/cli/description.h"
#include "client/cli/output.h"
#include "client/interrupt/interrupt.h"
#include "common/error/one_line.h"
#include "palpate/v1/recording.grpc.pb.h"

namespace palpate::cli {
namespace {

using Stub = v1::RecordingService::Stub;

constexpr std::chrono::milliseconds kPollPeriod(50);
constexpr std::chrono::milliseconds kShowPeriod(500);

v1::RecordingState Start(const Connection& connection, const RecordOptions& options) {
  v1::StartRecordingRequest request;
  request.set_path(connection.PathThere(options.path));
  request.set_overwrite(options.overwrite);
  return connection
      .Call(*v1::RecordingService::NewStub(connection.channel()), &Stub::StartRecording, request)
      .recording();
}

v1::RecordingState Stop(const Connection& connection) {
  return connection
      .Call(*v1::RecordingService::NewStub(connection.channel()), &Stub::StopRecording,
            v1::StopRecordingRequest())
      .recording();
}

v1::RecordingState Get(const Connection& connection) {
  return connection
      .Call(*v1::RecordingService::NewStub(connection.channel()), &Stub::GetRecording,
            v1::GetRecordingRequest())
      .recording();
}

Json ToJson(const v1::RecordingState& state) {
  return {{"running", state.running()},       {"path", state.path()},
          {"ticks", state.ticks()},           {"lost_ticks", state.lost_ticks()},
          {"size_bytes", state.size_bytes()}, {"error", state.error()},
          {"left_out", state.left_out()}};
}

void ThrowIfEndedEarly(const v1::RecordingState& state) {
  if (state.error().empty()) return;
  throw Error(state.disk_full() ? ErrorKind::kDiskFull : ErrorKind::kFailedPrecondition,
              "the recording ended early: " + state.error() + "; what it has is kept");
}

void WarnOfLeftOut(const v1::RecordingState& state) {
  if (!state.left_out().empty()) fmt::print(stderr, "palpate: {}\n", OneLine(state.left_out()));
}

// One line in place on a terminal; nothing elsewhere.
class Line {
 public:
  ~Line() { Clear(); }
  void Show(const std::string& text) {
    if (!is_terminal_) return;
    fmt::print(stderr, "\r\x1b[K{}", OneLine(text).substr(0, 79));
    drawn_ = true;
  }
  void Clear() {
    if (drawn_) std::fputs("\r\x1b[K", stderr);
    drawn_ = false;
  }

 private:
  const bool is_terminal_ = IsTerminal(STDERR_FILENO);
  bool drawn_ = false;
};

// Until the time is over, a signal comes, or the recording ends by itself.
void Await(const Connection& connection, const RecordOptions& options) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point start = Clock::now();
  Clock::time_point show_at = start;
  Line line;
  while (!Interrupt::IsRaised()) {
    const std::chrono::duration<double> since = Clock::now() - start;
    if (options.seconds && since.count() >= *options.seconds) return;
    if (Clock::now() >= show_at) {
      const v1::RecordingState state = Get(connection);
      if (!state.running()) return;
      line.Show("recording: " + DescribeRecording(state));
      show_at += kShowPeriod;
    }
    std::this_thread::sleep_for(kPollPeriod);
  }
}

}  // namespace

std::string DescribeRecording(const v1::RecordingState& state) {
  const auto ticks = static_cast<double>(state.ticks());
  const auto bytes = static_cast<double>(state.size_bytes());
  std::string text = fmt::format("{} ticks ({:.1f} s), {} lost, {:.1f} MB", state.ticks(),
                                 ticks * 1e-3, state.lost_ticks(), bytes * 1e-6);
  if (state.ticks() > 0) text += fmt::format(", {:.0f} bytes per tick", bytes / ticks);
  return text + ", to " + OneLine(state.path());
}

void RunRecording(const Connection& connection, const RecordOptions& options) {
  const Interrupt interrupt;
  WarnOfLeftOut(Start(connection, options));
  try {
    Await(connection, options);
  } catch (...) {
    // Whatever broke on our side, the daemon is not left recording.
    try {
      Stop(connection);
    } catch (const Error&) {
    }
    throw;
  }
  const v1::RecordingState state = Stop(connection);
  WriteOutput("recorded " + DescribeRecording(state) + "\n");
  WarnOfLeftOut(state);
  ThrowIfEndedEarly(state);
}

void StartRecording(const Connection& connection, const RecordOptions& options) {
  const v1::RecordingState state = Start(connection, options);
  WriteOutput("recording to " + OneLine(state.path()) + "\n");
  WarnOfLeftOut(state);
}

void StopRecording(const Connection& connection, bool json) {
  const v1::RecordingState state = Stop(connection);
  WriteOutput(json ? ToText(ToJson(state)) : "recorded " + DescribeRecording(state) + "\n");
  WarnOfLeftOut(state);
  ThrowIfEndedEarly(state);
}

void ShowRecording(const Connection& connection, bool json) {
  const v1::RecordingState state = Get(connection);
  if (json) {
    WriteOutput(ToText(ToJson(state)));
  } else if (state.running()) {
    WriteOutput("recording: " + DescribeRecording(state) + "\n");
  } else if (!state.error().empty()) {
    WriteOutput("not recording; the last: " + DescribeRecording(state) + "\n");
  } else if (!state.path().empty()) {
    WriteOutput("not recording; the last: " + DescribeRecording(state) + "\n");
  } else {
    WriteOutput("not recording\n");
  }
  WarnOfLeftOut(state);
  if (!state.running()) ThrowIfEndedEarly(state);
}

void MarkRecording(const Connection& connection, const std::string& text) {
  v1::MarkRequest request;
  request.set_text(text);
  const v1::MarkResponse response =
      connection.Call(*v1::RecordingService::NewStub(connection.channel()), &Stub::Mark, request);
  WriteOutput(fmt::format("marked at {} ns\n", response.time_ns()));
}

void Replay(const Connection& connection, const ReplayOptions& options) {
  const Interrupt interrupt;
  v1::ReplayRequest request;
  request.set_path(connection.PathThere(options.path));
  request.set_speed(options.speed);
  grpc::ClientContext context;
  const std::jthread canceller([&context](const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      if (Interrupt::IsRaised()) return context.TryCancel();
      std::this_thread::sleep_for(kPollPeriod);
    }
  });
  const auto stub = v1::RecordingService::NewStub(connection.channel());
  const auto reader = stub->Replay(&context, request);
  v1::ReplayResponse last;
  {
    Line line;
    for (v1::ReplayResponse event; reader->Read(&event); last = event) {
      if (!event.marker().empty()) {
        line.Clear();
        WriteOutput(fmt::format("{:.3f} s: {}\n", static_cast<double>(event.ticks()) * 1e-3,
                                OneLine(event.marker())));
      }
      line.Show(fmt::format("replaying: {} ticks, {} lost", event.ticks(), event.lost_ticks()));
    }
  }
  const grpc::Status status = reader->Finish();
  if (!status.ok() && Interrupt::IsRaised()) {
    throw Error(ErrorKind::kCancelled, "the replay was cancelled");
  }
  if (!status.ok()) throw connection.ErrorOfEnd(status);
  WriteOutput(fmt::format("replayed {} ticks, {} lost\n", last.ticks(), last.lost_ticks()));
}

}  // namespace palpate::cli
