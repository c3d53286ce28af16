#include "client/cli/series_command.h"

#include <fmt/core.h>

#include "client/cli/cancellable_call.h"
#include "client/cli/connection.h"
#include "client/cli/description.h"
#include "client/cli/load_command.h"
#include "client/cli/output.h"
#include "client/cli/progress.h"
#include "client/interrupt/interrupt.h"
#include "palpate/v1/series.grpc.pb.h"

namespace palpate::cli {
namespace {

Json ToJson(const v1::SeriesState& series) {
  return {{"frames", series.frames()},
          {"position_frames", series.position_frames()},
          {"playing", series.playing()},
          {"rate_hz", series.rate_hz()},
          {"loop", series.loop()},
          {"interpolate", series.interpolate()},
          {"memory_bytes", series.memory_bytes()},
          {"volume_revision", series.volume_revision()}};
}

void Print(const v1::SeriesState& series, bool json) {
  WriteOutput(json ? ToText(ToJson(series)) : Describe(series));
}

}  // namespace

std::string Describe(const v1::SeriesState& series) {
  return fmt::format(
      "{:<10}frame {:.6g} of 0 to {}, {} at {:g} frames/s{}{}; {:.1f} MiB\n", "series",
      series.position_frames(), series.frames() > 0 ? series.frames() - 1 : 0,
      series.playing() ? "playing" : "paused", series.rate_hz(), series.loop() ? ", in a loop" : "",
      series.interpolate() ? ", interpolated" : "",
      static_cast<double>(series.memory_bytes()) / (1024.0 * 1024.0));
}

void LoadSeries(const Connection& connection, v1::LoadSeriesRequest request) {
  for (std::string& source : *request.mutable_sources()) source = SourceThere(connection, source);
  v1::LoadSeriesResult result;
  bool has_result = false;
  {
    const Interrupt interrupt;
    ProgressPrinter printer;
    const auto stub = v1::SeriesService::NewStub(connection.channel());
    StreamCall<v1::LoadSeriesResponse> call([&](auto* context, auto* queue) {
      return stub->PrepareAsyncLoadSeries(context, request, queue);
    });
    for (v1::LoadSeriesResponse response; call.Read(response);) {
      if (response.has_progress()) {
        printer.Print(response.progress().stage(), response.progress().fraction());
      } else if (response.has_result()) {
        result = response.result();
        has_result = true;
      }
    }
    const grpc::Status status = call.Finish();
    if (!status.ok()) throw ErrorOfLoad(connection, status);
  }
  if (!has_result) {
    throw Error(ErrorKind::kInternal, "palpated ended the load without a result");
  }
  PrintWarnings(result.volume());
  WriteOutput(Describe(result.volume()) + Describe(result.series()));
}

void ControlSeries(const Connection& connection, const v1::ControlSeriesRequest& request,
                   bool json) {
  Print(connection
            .Call(*v1::SeriesService::NewStub(connection.channel()),
                  &v1::SeriesService::Stub::ControlSeries, request)
            .series(),
        json);
}

void PrintSeries(const Connection& connection, bool json) {
  Print(connection
            .Call(*v1::SeriesService::NewStub(connection.channel()),
                  &v1::SeriesService::Stub::GetSeries, v1::GetSeriesRequest())
            .series(),
        json);
}

}  // namespace palpate::cli
