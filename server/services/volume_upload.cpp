// VolumeService::UploadVolume.

#include <chrono>
#include <optional>
#include <string>
#include <utility>

#include "common/error/error.h"
#include "common/wire/status.h"
#include "server/log/log.h"
#include "server/realtime/tick_timer.h"
#include "server/services/volume_messages.h"
#include "server/services/volume_service.h"

namespace palpate {
namespace {

constexpr char kMethod[] = "/palpate.v1.VolumeService/UploadVolume";
constexpr std::size_t kMostBytesPerMessage = 1 << 20;
// Of each send_patience: an upload holds memory of the budget. 140 kbit/s at 30 s.
constexpr std::size_t kLeastBytes = 512 << 10;

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
                                      const SettingsUpdate& settings,
                                      const LoadCancelled& cancelled) {
  // only this user can enter its folder
  request.source = std::filesystem::canonical(upload.path());
  request.source_stays = false;
  request.title = upload.title();
  const auto quiet = [](std::string_view, double) {};
  try {
    return session_.Load(request, quiet, cancelled, settings);
  } catch (const std::exception& error) {
    throw WithTitle(error, upload);
  }
}

// An upload that is received. Messages come one at a time; each is written by a thread for calls.
class VolumeService::Uploading final : public grpc::ServerReadReactor<v1::UploadVolumeRequest> {
 public:
  Uploading(VolumeService& service, CallContext* context, v1::UploadVolumeResponse* response)
      : service_(service),
        context_(context),
        response_(response),
        admission_(service.calls_.access().Admit(context, kMethod)) {
    admission_.ok() ? ReadMore() : End(admission_.status());
  }

  void OnReadDone(bool ok) override {
    patience_ns_ -= MonotonicNowNs() - read_began_ns_;
    admission_.MustSendBy(0);
    service_.calls_.threads().Run(kMethod, [this, ok] {
      try {
        ok ? Take() : Load();
      } catch (const std::exception& error) {
        const Error cancelled(ErrorKind::kCancelled, "it was cancelled");
        End(admission_.Failed(context_->IsCancelled() ? cancelled : error));
      }
    });
  }
  void OnDone() override { delete this; }

 private:
  // Only the client's own time counts: not what the daemon needs to write the bytes.
  void ReadMore() {
    read_began_ns_ = MonotonicNowNs();
    admission_.MustSendBy(read_began_ns_ + patience_ns_);
    StartRead(&message_);
  }

  std::int64_t Patience() const {
    return std::chrono::nanoseconds(service_.calls_.access().limits().send_patience).count();
  }

  void Take() {
    if (!upload_) {
      Begin();
    } else {
      if (!message_.has_data()) Refuse("after the start of an upload, only data may follow");
      if (message_.data().size() > kMostBytesPerMessage) {
        Refuse("a message of an upload holds at most 1 MiB of data");
      }
      upload_->Append(message_.data());
      sent_bytes_ += message_.data().size();
    }
    if (sent_bytes_ >= kLeastBytes) {
      sent_bytes_ = 0;
      patience_ns_ = Patience();
    }
    ReadMore();
  }

  void Begin() {
    if (!message_.has_start()) Refuse("an upload begins with its start");
    const v1::UploadVolumeStart& start = message_.start();
    service_.calls_.RequireNow(kMethod);
    options_ = FromProto(start.options());
    settings_ = SettingsOf(start.options());
    service_.session_.CheckSettings(options_, settings_);
    service_.session_.store().RequireSaved(options_.discards_edits);
    UploadStart announced{.name = start.name(),
                          .size_bytes = start.size_bytes(),
                          .crc32 = start.crc32(),
                          .holds_voxels = options_.raw.has_value()};
    for (const v1::UploadedFile& file : start.files()) {
      announced.files.push_back({file.name(), file.size_bytes()});
    }
    upload_.emplace(service_.uploads_, *service_.session_.loader().budget, announced);
  }

  // Call it after the last message. If the stream broke off, there are too few bytes.
  void Load() {
    if (!upload_) Refuse("an upload begins with its start");
    upload_->Finish();
    const auto cancelled = [this] { return context_->IsCancelled(); };
    if (cancelled()) throw Error(ErrorKind::kCancelled, "the upload was cancelled");
    const VolumeState state = service_.LoadUpload(*upload_, options_, settings_, cancelled);
    admission_.Changed("volume");
    const AppliedTick applied = service_.session_.WaitForServo(state.scene_revision);
    SetResult(service_.session_, state, applied, *response_);
    LogInfo("loaded {} (volume revision {}) at tick {}, isovalue {:g}", upload_->title(),
            state.volume->revision(), applied.tick, state.isovalue);
    End(grpc::Status::OK);
  }

  // The upload's file and its claim go before the answer, not when the client has read it.
  void End(const grpc::Status& status) {
    upload_.reset();
    Finish(admission_.Answered(status, response_->ByteSizeLong()));
  }

  VolumeService& service_;
  CallContext* const context_;
  v1::UploadVolumeResponse* const response_;
  Admission admission_;
  v1::UploadVolumeRequest message_;
  LoadRequest options_;
  SettingsUpdate settings_;
  std::optional<Upload> upload_;
  std::int64_t read_began_ns_ = 0;
  std::int64_t patience_ns_ = Patience();  // with a client that sends too slowly
  std::size_t sent_bytes_ = 0;             // since it was whole
};

grpc::ServerReadReactor<v1::UploadVolumeRequest>* VolumeService::UploadVolume(
    CallContext* context, v1::UploadVolumeResponse* response) {
  return new Uploading(*this, context, response);
}

}  // namespace palpate
