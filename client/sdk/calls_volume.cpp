// The calls of Calls about voxels.
#include <algorithm>

#include "client/sdk/calls.h"
#include "client/sdk/link.h"
#include "client/sdk/messages.h"
#include "client/sdk/upload.h"
#include "client/sdk/volume_reader.h"
#include "palpate/v1/series.grpc.pb.h"
#include "palpate/v1/volume.grpc.pb.h"

namespace palpate::client {
namespace {

using Volume = v1::VolumeService;

constexpr char kLoadCancelled[] = "loading was cancelled; the volume before it stays";
constexpr std::chrono::milliseconds kPoll{50};
// The most losses of a download in a row, with no message in between.
constexpr int kMostLosses = 5;

// Runs a call that streams progress messages and, at the end, one result.
template <class Service, class Response, class Prepare>
auto RunToResult(Link& link, const google::protobuf::Message& request, const Prepare& prepare,
                 const ProgressFunction& progress, const char* cancelled) {
  std::optional<std::decay_t<decltype(std::declval<Response>().result())>> result;
  Progress state;
  link.Stream<Service, Response>(
      request, prepare,
      [&](const Response& event) {
        if (event.has_result()) result = event.result();
        if (!event.has_progress()) return;
        state = {event.progress().stage(), event.progress().fraction()};
      },
      // After the result, the call cannot be cancelled any more.
      [&] { return result || !progress || progress(state); }, cancelled);
  if (!result) {
    throw Error(ErrorKind::kInternal, "palpated ended the call without a result");
  }
  return *result;
}

v1::EditVolumeResponse RunFilterCall(Link& link, const v1::FilterVolumeRequest& request,
                                     const ProgressFunction& progress, const char* cancelled) {
  return RunToResult<Volume, v1::FilterVolumeResponse>(
      link, request,
      [&](Volume::Stub& stub, auto* context, auto* queue) {
        return stub.PrepareAsyncFilterVolume(context, request, queue);
      },
      progress, cancelled);
}

Progress ProgressOf(const VolumeMirror& mirror, std::uint64_t& most_left) {
  most_left = std::max(most_left, mirror.bricks_left());
  if (most_left == 0) return {"receiving"};
  const auto all = static_cast<double>(most_left);
  return {"receiving", 1.0 - static_cast<double>(mirror.bricks_left()) / all,
          "of " + std::to_string(most_left) + " bricks"};
}

}  // namespace

VolumeInfo Calls::GetVolume() {
  return FromProto(link_->Call<Volume>(&Volume::Stub::GetVolume, v1::GetVolumeRequest()).volume());
}

LoadResult Calls::LoadVolume(const std::string& source, const LoadOptions& options,
                             const ProgressFunction& progress) {
  v1::LoadVolumeRequest request = ToProto(options);
  request.set_source(source);
  return FromProto(RunToResult<Volume, v1::LoadVolumeResponse>(
      *link_, request,
      [&](Volume::Stub& stub, auto* context, auto* queue) {
        return stub.PrepareAsyncLoadVolume(context, request, queue);
      },
      progress, kLoadCancelled));
}

LoadResult Calls::UploadVolume(const std::filesystem::path& file, const LoadOptions& options,
                               const ProgressFunction& progress) {
  GetVolume();  // waits for the first volume; the upload itself would read the file again and again
  return Upload(*link_, file, options, progress);
}

DownloadResult Calls::DownloadVolume(const ProgressFunction& progress) {
  DownloadResult result;
  VolumeReader reader(link_->volume_channel(), result.volume);
  std::uint64_t most_left = 0;
  for (Progress state;;) {
    const VolumeReader::Event event = reader.Next(kPoll);
    if (event == VolumeReader::Event::kApplied) state = ProgressOf(result.volume, most_left);
    if (event == VolumeReader::Event::kLost && reader.is_loading()) {
      state = {reader.last_loss()->what()};
    }
    if (progress && !progress(state)) {
      throw Error(ErrorKind::kCancelled, "the download was cancelled; nothing was kept");
    }
    link_->ThrowIfCancelled();
    if (event == VolumeReader::Event::kLost && reader.losses_in_a_row() >= kMostLosses) {
      const Error loss = *reader.last_loss();
      if (loss.kind() != ErrorKind::kUnavailable) throw Error(loss);
      throw link_->ErrorOf({grpc::StatusCode::UNAVAILABLE, loss.what()});
    }
    if (event == VolumeReader::Event::kComplete) break;
  }
  result.bytes_received = reader.bytes_received();
  return result;
}

SaveResult Calls::SaveVolume(const std::string& path, bool overwrite,
                             const ProgressFunction& progress) {
  v1::SaveVolumeRequest request;
  request.set_path(path);
  request.set_overwrite(overwrite);
  return FromProto(RunToResult<Volume, v1::SaveVolumeResponse>(
      *link_, request,
      [&](Volume::Stub& stub, auto* context, auto* queue) {
        return stub.PrepareAsyncSaveVolume(context, request, queue);
      },
      progress, "saving was cancelled; there is no new file"));
}

EditResult Calls::Apply(const Edit& edit, const ProgressFunction& progress) {
  v1::FilterVolumeRequest request;
  *request.mutable_edit() = ToProto(edit);
  try {
    return FromProto(link_->Call<Volume>(&Volume::Stub::EditVolume, request.edit()));
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kTooLarge || request.edit().has_block()) throw;
  }
  return FromProto(
      RunFilterCall(*link_, request, progress, "the edit was cancelled; nothing was changed"));
}

EditResult Calls::RunFilter(const Filter& filter, const ProgressFunction& progress) {
  return FromProto(RunFilterCall(*link_, ToProto(filter), progress,
                                 "the filter was cancelled; nothing was changed"));
}

EditResult Calls::Undo(std::optional<std::uint64_t> expected_revision) {
  v1::UndoEditRequest request;
  if (expected_revision) request.set_expected_revision(*expected_revision);
  return FromProto(link_->Call<Volume>(&Volume::Stub::UndoEdit, request));
}

EditResult Calls::Redo(std::optional<std::uint64_t> expected_revision) {
  v1::RedoEditRequest request;
  if (expected_revision) request.set_expected_revision(*expected_revision);
  return FromProto(link_->Call<Volume>(&Volume::Stub::RedoEdit, request));
}

EditResult Calls::Revert(std::optional<std::uint64_t> expected_revision) {
  v1::RevertVolumeRequest request;
  if (expected_revision) request.set_expected_revision(*expected_revision);
  return FromProto(link_->Call<Volume>(&Volume::Stub::RevertVolume, request));
}

SeriesResult Calls::LoadSeries(const std::vector<std::string>& sources, const LoadOptions& options,
                               const ProgressFunction& progress) {
  v1::LoadSeriesRequest request;
  for (const std::string& source : sources) request.add_sources(source);
  *request.mutable_options() = ToProto(options);
  return FromProto(RunToResult<v1::SeriesService, v1::LoadSeriesResponse>(
      *link_, request,
      [&](v1::SeriesService::Stub& stub, auto* context, auto* queue) {
        return stub.PrepareAsyncLoadSeries(context, request, queue);
      },
      progress, kLoadCancelled));
}

}  // namespace palpate::client
