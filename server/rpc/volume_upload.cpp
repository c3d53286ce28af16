// VolumeService::UploadVolume.

#include <optional>
#include <string>
#include <utility>

#include "common/error/error.h"
#include "common/wire/status.h"
#include "server/log/log.h"
#include "server/rpc/volume_messages.h"
#include "server/rpc/volume_service.h"

namespace palpate {
namespace {

constexpr std::size_t kMostBytesPerMessage = 1 << 20;

// Takes all messages. If the stream breaks off, the upload ends with too few bytes.
void Receive(grpc::ServerReader<v1::UploadVolumeRequest>& reader, Upload& upload) {
  for (v1::UploadVolumeRequest message; reader.Read(&message);) {
    if (!message.has_data()) Refuse("after the start of an upload, only data may follow");
    if (message.data().size() > kMostBytesPerMessage) {
      Refuse("a message of an upload holds at most 1 MiB of data");
    }
    upload.Append(message.data());
  }
  upload.Finish();
}

// Replaces the file's path by the upload's title: the client does not know the path.
Error WithTitle(const std::exception& error, const Upload& upload) {
  std::string message = error.what();
  const std::string path = upload.path().string();
  for (std::size_t at = 0; (at = message.find(path, at)) != std::string::npos;) {
    message.replace(at, path.size(), upload.title());
    at += upload.title().size();
  }
  const auto* known = dynamic_cast<const Error*>(&error);
  return {known ? known->kind() : ErrorKind::kInternal, message};
}

}  // namespace

VolumeState VolumeService::LoadUpload(const Upload& upload, LoadRequest request,
                                      const LoadCancelled& cancelled, AppliedTick& applied) {
  // only this user can enter its folder
  request.source = std::filesystem::canonical(upload.path());
  request.source_stays = false;
  request.title = upload.title();
  const auto quiet = [](std::string_view, double) {};
  try {
    return session_.LoadAndWait(request, quiet, cancelled, applied);
  } catch (const std::exception& error) {
    throw WithTitle(error, upload);
  }
}

grpc::Status VolumeService::UploadVolume(grpc::ServerContext* context,
                                         grpc::ServerReader<v1::UploadVolumeRequest>* reader,
                                         v1::UploadVolumeResponse* response) {
  const Admission admission = access_.Admit(context, "/palpate.v1.VolumeService/UploadVolume");
  if (!admission.ok()) return admission.status();
  try {
    v1::UploadVolumeRequest message;
    if (!reader->Read(&message) || !message.has_start()) Refuse("an upload begins with its start");
    const v1::UploadVolumeStart& start = message.start();
    const LoadRequest options = FromProto(start.options());
    Upload upload(uploads_, *session_.loader().budget,
                  {.name = start.name(),
                   .size_bytes = start.size_bytes(),
                   .crc32 = start.crc32(),
                   .holds_voxels = options.raw.has_value()});
    Receive(*reader, upload);
    const auto cancelled = [context] { return context->IsCancelled(); };
    if (cancelled()) throw Error(ErrorKind::kCancelled, "the upload was cancelled");
    AppliedTick applied;
    const VolumeState state = LoadUpload(upload, options, cancelled, applied);
    *response->mutable_volume() = ToProto(state);
    response->set_applied_tick(applied.tick);
    response->set_settings_revision(state.settings_revision);
    LogInfo("loaded {} (volume revision {}) at tick {}", upload.title(), state.volume->revision(),
            applied.tick);
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    if (!context->IsCancelled()) return admission.Failed(error);
    return admission.Failed(Error(ErrorKind::kCancelled, "it was cancelled"));
  }
}

}  // namespace palpate
