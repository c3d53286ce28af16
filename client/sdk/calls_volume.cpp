// The calls of Calls about voxels.
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "client/sdk/calls.h"
#include "client/sdk/link.h"
#include "client/sdk/messages.h"
#include "client/sdk/progress.h"
#include "client/sdk/volume.h"
#include "client/sdk/volume_reader.h"
#include "palpate/v1/device.grpc.pb.h"
#include "palpate/v1/series.grpc.pb.h"
#include "palpate/v1/volume.grpc.pb.h"

namespace palpate::client {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kChunkBytes = 1 << 20;
// The share of sending in the progress. The time that the daemon then needs is not known; it has
// the rest.
constexpr double kSendingShare = 0.5;
constexpr char kCancelled[] = "loading was cancelled; the volume before it stays";

std::ifstream Open(const fs::path& file) {
  std::error_code error;
  const fs::file_status status = fs::status(file, error);
  if (!fs::exists(status)) {
    throw Error(ErrorKind::kNotFound, file.string() + ": there is no such file");
  }
  if (!fs::is_regular_file(status)) Refuse(file.string() + ": this is no file; name one");
  if (access(file.c_str(), R_OK) != 0) {
    throw Error(ErrorKind::kPermissionDenied, file.string() + ": the file may not be read");
  }
  std::ifstream in(file, std::ios::binary);
  if (!in) throw Error(ErrorKind::kNotFound, file.string() + ": the file cannot be opened");
  return in;
}

// Reads the next chunk and returns its size; 0 at the end.
std::size_t ReadChunk(std::ifstream& in, std::string& chunk) {
  chunk.resize(kChunkBytes);
  in.read(chunk.data(), static_cast<std::streamsize>(chunk.size()));
  chunk.resize(static_cast<std::size_t>(in.gcount()));
  if (in.bad()) throw Error(ErrorKind::kUnavailable, "the file cannot be read to its end");
  return chunk.size();
}

// Returns the files to send: those of a folder, or the file itself.
std::vector<fs::path> FilesOf(const fs::path& path) {
  std::error_code error;
  if (!fs::is_directory(path, error)) return {path};
  std::vector<fs::path> files;
  for (fs::directory_iterator entry(path, error), end; !error && entry != end;
       entry.increment(error)) {
    if (entry->is_regular_file()) files.push_back(entry->path());
  }
  if (error) {
    throw Error(ErrorKind::kPermissionDenied, path.string() + ": " + error.message());
  }
  if (files.empty()) Refuse(path.string() + ": there are no files in it");
  std::sort(files.begin(), files.end());
  return files;
}

// "CT/" and "CT" are the same folder.
std::string NameOf(const fs::path& path) {
  const fs::path full = fs::absolute(path).lexically_normal();
  return (full.has_filename() ? full : full.parent_path()).filename();
}

std::string Of(std::uint64_t sent, std::uint64_t size_bytes) {
  constexpr double kMib = 1024.0 * 1024.0;
  char text[64];
  std::snprintf(text, sizeof text, "%.1f of %.1f MiB", static_cast<double>(sent) / kMib,
                static_cast<double>(size_bytes) / kMib);
  return text;
}

class Sending {
 public:
  Sending(const fs::path& path, const ProgressFunction& progress)
      : path_(path), files_(FilesOf(path)), progress_(progress) {}

  bool GoesOn() const { return !progress_ || progress_(state_); }

  // Reads everything once, because the daemon needs sizes and checksum in advance.
  v1::UploadVolumeStart Start(const Link& link) const {
    v1::UploadVolumeStart start;
    start.set_name(NameOf(path_));
    uLong crc = crc32_z(0, nullptr, 0);
    for (const fs::path& file : files_) {
      std::ifstream in = Open(file);
      std::uint64_t size = 0;
      for (std::string chunk; ReadChunk(in, chunk) > 0;) {
        link.ThrowIfCancelled();
        if (!GoesOn()) throw Error(ErrorKind::kCancelled, kCancelled);
        size += chunk.size();
        crc = crc32_z(crc, reinterpret_cast<const Bytef*>(chunk.data()), chunk.size());
      }
      start.set_size_bytes(start.size_bytes() + size);
      if (file == path_) continue;
      v1::UploadedFile& announced = *start.add_files();
      announced.set_name(file.filename());
      announced.set_size_bytes(size);
    }
    start.set_crc32(static_cast<std::uint32_t>(crc));
    return start;
  }

  // Ends early if the daemon takes no more. The call's status then says why.
  template <class Writer>
  void Send(Writer& writer, PolledCall& polled, const v1::UploadVolumeRequest& start) {
    const std::uint64_t size = start.start().size_bytes();
    const auto write = [&](const v1::UploadVolumeRequest& message) {
      writer.Write(message, &polled);
      return polled.Wait();
    };
    CheckText(start);
    if (!write(start)) return;
    v1::UploadVolumeRequest message;
    std::uint64_t sent = 0;
    for (const fs::path& file : files_) {
      std::ifstream in = Open(file);
      while (ReadChunk(in, *message.mutable_data()) > 0) {
        sent += message.data().size();
        if (!write(message)) return;
        const double share = static_cast<double>(sent) / static_cast<double>(size);
        state_ = {"sending", kSendingShare * share, Of(sent, size)};
        polled.Ask();
      }
    }
    writer.WritesDone(&polled);
    polled.Wait();
    state_ = {"loading", kSendingShare};
    polled.Ask();
  }

 private:
  const fs::path path_;
  const std::vector<fs::path> files_;
  const ProgressFunction& progress_;
  Progress state_;
};

// Sends a file of this machine to the daemon.
//
// Threads: one. Errors: kNotFound, kInvalidArgument (not a file), kPermissionDenied, kUnavailable
// (the file cannot be read to its end), and those of the call.
LoadResult Upload(Link& link, const fs::path& file, const LoadOptions& options,
                  const ProgressFunction& progress) {
  Sending sending(file, progress);
  v1::UploadVolumeRequest start;
  *start.mutable_start() = sending.Start(link);
  *start.mutable_start()->mutable_options() = ToProto(options);
  const auto channel = link.volume_channel();
  // palpated takes only a small first call of a connection.
  if (channel->GetState(false) != GRPC_CHANNEL_READY) {
    link.Call<v1::DeviceService>(&v1::DeviceService::Stub::GetDevice, v1::GetDeviceRequest(),
                                 kCallTimeout, channel);
  }
  const auto stub = v1::VolumeService::NewStub(channel);
  grpc::ClientContext context;
  const Link::Registered registered(link, context);
  v1::UploadVolumeResponse response;
  PolledCall polled(context, [&sending] { return sending.GoesOn(); });
  const auto writer = stub->PrepareAsyncUploadVolume(&context, &response, &polled.queue());
  writer->StartCall(&polled);
  polled.Wait();
  std::exception_ptr thrown;
  try {
    sending.Send(*writer, polled, start);
  } catch (...) {
    thrown = std::current_exception();
    context.TryCancel();
  }
  const grpc::Status status = polled.Finish(*writer);
  if (thrown) std::rethrow_exception(thrown);
  if (status.ok()) {
    return {FromProto(response.volume()), response.applied_tick(), response.settings_revision(),
            response.isovalue()};
  }
  throw polled.is_cancelled() ? Error(ErrorKind::kCancelled, kCancelled) : link.ErrorOfEnd(status);
}

using Volume = v1::VolumeService;

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
      progress, kCancelled));
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
      progress, kCancelled));
}

}  // namespace palpate::client
