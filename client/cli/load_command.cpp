#include "client/cli/load_command.h"

#include <fmt/core.h>

#include <filesystem>

#include "client/cli/cancellable_call.h"
#include "client/cli/connection.h"
#include "client/cli/description.h"
#include "client/cli/output.h"
#include "client/cli/progress_call.h"
#include "common/error/one_line.h"
#include "palpate/v1/volume.grpc.pb.h"

namespace palpate::cli {

Error ErrorOfLoad(const Connection& connection, const grpc::Status& status) {
  if (!Interrupt::IsRaised()) return connection.ErrorOfEnd(status);
  return {ErrorKind::kCancelled, "loading was cancelled; the volume before it stays"};
}

void PrintWarnings(const v1::VolumeDescription& volume) {
  for (const std::string& warning : volume.warnings()) {
    fmt::print(stderr, "palpate: warning: {}\n", OneLine(warning));
  }
}

void LoadVolume(const Connection& connection, v1::LoadVolumeRequest request) {
  request.set_source(SourceThere(connection, request.source()));
  const auto stub = v1::VolumeService::NewStub(connection.channel());
  const v1::LoadVolumeResult result = RunWithProgress<v1::LoadVolumeResponse>(
      connection,
      [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
        return stub->PrepareAsyncLoadVolume(context, request, queue);
      },
      "loading was cancelled; the volume before it stays");
  PrintWarnings(result.volume());
  WriteOutput(Describe(result.volume()) + fmt::format("applied at tick {}, settings revision {}\n",
                                                      result.applied_tick(),
                                                      result.settings_revision()));
}

std::string SourceThere(const Connection& connection, const std::string& source) {
  return source.starts_with("builtin:") ? source : connection.PathThere(source);
}

}  // namespace palpate::cli
