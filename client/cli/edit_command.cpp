#include "client/cli/edit_command.h"

#include <fmt/core.h>

#include <cstdio>
#include <memory>

#include "client/cli/connection.h"
#include "client/cli/description.h"
#include "client/cli/output.h"
#include "client/cli/progress_call.h"
#include "common/error/one_line.h"
#include "common/wire/limits.h"
#include "palpate/v1/volume.grpc.pb.h"

namespace palpate::cli {
namespace {

Json ToJson(const v1::EditVolumeResponse& response) {
  Json json = {{"volume_revision", response.volume_revision()},
               {"applied_tick", response.applied_tick()},
               {"changed", nullptr},
               {"changed_voxels", response.changed_voxels()},
               {"undo_steps", response.undo_steps()},
               {"redo_steps", response.redo_steps()}};
  if (response.has_changed()) {
    const v1::IndexBox& box = response.changed();
    json["changed"] = {{"min", {box.min_x(), box.min_y(), box.min_z()}},
                       {"max", {box.max_x(), box.max_y(), box.max_z()}}};
  }
  return json;
}

void Print(const v1::EditVolumeResponse& response, bool json) {
  WriteOutput(json ? ToText(ToJson(response)) : DescribeEdit(response) + "\n");
}

template <class Request, class Method>
v1::EditVolumeResponse Move(const Connection& connection, Method method,
                            const std::optional<std::uint64_t>& expected_revision) {
  Request request;
  if (expected_revision) request.set_expected_revision(*expected_revision);
  return connection.Call(*v1::VolumeService::NewStub(connection.channel()), method, request);
}

}  // namespace

void EditVolume(const Connection& connection, const v1::EditVolumeRequest& request, bool json) {
  Print(connection.Call(*v1::VolumeService::NewStub(connection.channel()),
                        &v1::VolumeService::Stub::EditVolume, request),
        json);
}

void FilterVolume(const Connection& connection, const v1::FilterVolumeRequest& request, bool json) {
  const auto stub = v1::VolumeService::NewStub(connection.channel());
  Print(RunWithProgress<v1::FilterVolumeResponse>(
            connection,
            [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
              return stub->PrepareAsyncFilterVolume(context, request, queue);
            },
            "the filter was cancelled; nothing was changed"),
        json);
}

void MoveInHistory(const Connection& connection, HistoryCommand command,
                   const std::optional<std::uint64_t>& expected_revision, bool json) {
  using Stub = v1::VolumeService::Stub;
  switch (command) {
    case HistoryCommand::kUndo:
      Print(Move<v1::UndoEditRequest>(connection, &Stub::UndoEdit, expected_revision), json);
      break;
    case HistoryCommand::kRedo:
      Print(Move<v1::RedoEditRequest>(connection, &Stub::RedoEdit, expected_revision), json);
      break;
    case HistoryCommand::kRevert:
      Print(Move<v1::RevertVolumeRequest>(connection, &Stub::RevertVolume, expected_revision),
            json);
      break;
  }
}

void SaveVolume(const Connection& connection, v1::SaveVolumeRequest request, bool json) {
  request.set_path(connection.PathThere(request.path()));
  const auto stub = v1::VolumeService::NewStub(connection.channel());
  const v1::SaveVolumeResult result = RunWithProgress<v1::SaveVolumeResponse>(
      connection,
      [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
        return stub->PrepareAsyncSaveVolume(context, request, queue);
      },
      "saving was cancelled; there is no new file");
  if (json) {
    WriteOutput(ToText(Json{{"path", request.path()},
                            {"volume_revision", result.volume_revision()},
                            {"size_bytes", result.size_bytes()}}));
    return;
  }
  WriteOutput(fmt::format("saved volume revision {} to {}, {:.1f} MiB\n", result.volume_revision(),
                          OneLine(request.path()),
                          static_cast<double>(result.size_bytes()) / (1024.0 * 1024.0)));
}

std::string ReadBlockValues(const std::string& file) {
  const auto close = [](std::FILE* f) {
    if (f != stdin) std::fclose(f);
  };
  const std::unique_ptr<std::FILE, decltype(close)> in(
      file == "-" ? stdin : std::fopen(file.c_str(), "rb"), close);
  if (!in) throw Error(ErrorKind::kNotFound, file + ": there is no such file that can be read");
  const std::string name = file == "-" ? "stdin" : file;
  std::string bytes(kMostBlockBytes + 1, '\0');
  bytes.resize(std::fread(bytes.data(), 1, bytes.size(), in.get()));
  if (std::ferror(in.get())) throw Error(ErrorKind::kInvalidArgument, name + ": cannot be read");
  if (bytes.size() > kMostBlockBytes) {
    throw Error(ErrorKind::kTooLarge,
                name + ": a block has at most 3 MiB of values: send it in parts");
  }
  return bytes;
}

std::string DescribeEdit(const v1::EditVolumeResponse& response) {
  std::string what = "no voxel changed";
  if (response.has_changed()) {
    const v1::IndexBox& box = response.changed();
    what = fmt::format("{} voxel{} changed within {} {} {} to {} {} {}", response.changed_voxels(),
                       response.changed_voxels() == 1 ? "" : "s", box.min_x(), box.min_y(),
                       box.min_z(), box.max_x(), box.max_y(), box.max_z());
  }
  return fmt::format("{}, applied at tick {}, volume revision {}; {} to undo, {} to redo", what,
                     response.applied_tick(), response.volume_revision(), response.undo_steps(),
                     response.redo_steps());
}

}  // namespace palpate::cli
