#include "client/cli/load_command.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "client/cli/description.h"
#include "client/cli/interrupt.h"
#include "client/cli/output.h"
#include "palpate/v1/volume.grpc.pb.h"

namespace palpate::cli {
namespace {

constexpr std::chrono::milliseconds kInterruptPoll(50);
constexpr int kBarWidth = 30;

// On a terminal a bar in place; else a line per stage and per quarter.
class ProgressPrinter {
 public:
  ~ProgressPrinter() {
    if (bar_drawn_) {
      std::fputs("\r\x1b[K", stderr);
    }
  }

  void Print(const v1::LoadVolumeProgress& progress) {
    const double fraction = std::clamp(progress.fraction(), 0.0, 1.0);
    const std::string stage = OneLine(progress.stage());
    if (is_terminal_) {
      const auto filled = static_cast<std::size_t>(fraction * kBarWidth);
      fmt::print(stderr, "\r\x1b[K[{:<{}}] {:3.0f} % {:.30}", std::string(filled, '#'), kBarWidth,
                 100.0 * fraction, stage);
      bar_drawn_ = true;
      return;
    }
    const int quarter = static_cast<int>(fraction * 4.0);
    if (stage != stage_ || quarter != quarter_) {
      stage_ = stage;
      quarter_ = quarter;
      fmt::print(stderr, "{:3.0f} % {}\n", 100.0 * fraction, stage);
    }
  }

 private:
  const bool is_terminal_ = IsTerminal(STDERR_FILENO);
  bool bar_drawn_ = false;
  std::string stage_;
  int quarter_ = -1;
};

// The call, one step at a time, so that a signal can cancel it between two.
class LoadCall {
 public:
  LoadCall(const Connection& connection, const v1::LoadVolumeRequest& request)
      : stub_(v1::VolumeService::NewStub(connection.channel())),
        call_(stub_->PrepareAsyncLoadVolume(&context_, request, &queue_)) {
    call_->StartCall(this);
    Wait();
  }

  ~LoadCall() {
    // A call that is abandoned, because our output broke, must end too.
    if (!finished_) {
      context_.TryCancel();
      Finish();
    }
    queue_.Shutdown();
    void* tag = nullptr;
    bool ok = false;
    while (queue_.Next(&tag, &ok)) {
    }
  }

  LoadCall(const LoadCall&) = delete;
  LoadCall& operator=(const LoadCall&) = delete;

  bool Read(v1::LoadVolumeResponse& response) {
    call_->Read(&response, this);
    return Wait();
  }

  grpc::Status Finish() {
    grpc::Status status;
    call_->Finish(&status, this);
    Wait();
    finished_ = true;
    return status;
  }

 private:
  bool Wait() {
    void* tag = nullptr;
    bool ok = false;
    while (queue_.AsyncNext(&tag, &ok, std::chrono::system_clock::now() + kInterruptPoll) ==
           grpc::CompletionQueue::TIMEOUT) {
      if (Interrupt::IsRaised()) {
        context_.TryCancel();
      }
    }
    return ok;
  }

  bool finished_ = false;
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<v1::VolumeService::Stub> stub_;
  std::unique_ptr<grpc::ClientAsyncReader<v1::LoadVolumeResponse>> call_;
};

v1::LoadVolumeResult Load(const Connection& connection, const v1::LoadVolumeRequest& request) {
  const Interrupt interrupt;
  ProgressPrinter printer;
  LoadCall call(connection, request);
  v1::LoadVolumeResult result;
  bool has_result = false;
  v1::LoadVolumeResponse response;
  while (call.Read(response)) {
    if (response.has_progress()) {
      printer.Print(response.progress());
    } else if (response.has_result()) {
      result = response.result();
      has_result = true;
    }
  }
  const grpc::Status status = call.Finish();
  if (status.ok() && !has_result) {
    throw Error(ErrorKind::kInternal, "palpated ended the load without a result");
  }
  if (!status.ok() && Interrupt::IsRaised()) {
    throw Error(ErrorKind::kCancelled, "loading was cancelled; the volume before it stays");
  }
  if (!status.ok()) {
    throw connection.ErrorOf(status);
  }
  return result;
}

}  // namespace

void LoadVolume(const Connection& connection, const v1::LoadVolumeRequest& request) {
  const v1::LoadVolumeResult result = Load(connection, request);
  WriteOutput(Describe(result.volume()) + fmt::format("applied at tick {}, settings revision {}\n",
                                                      result.applied_tick(),
                                                      result.settings_revision()));
}

std::string SourceForDaemon(const std::string& source) {
  return source.rfind("builtin:", 0) == 0 ? source : std::filesystem::absolute(source).string();
}

}  // namespace palpate::cli
