#include "server/services/volume_service.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <cstring>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "common/error/error.h"
#include "common/wire/convert.h"
#include "common/wire/limits.h"
#include "common/wire/status.h"
#include "common/wire/values.h"
#include "palpate/v1/edit.pb.h"
#include "server/log/log.h"
#include "server/realtime/tick_timer.h"
#include "server/services/volume_messages.h"
#include "server/session/edits/volume_editor.h"
#include "server/volume/edit/edit.h"
#include "server/volume/edit/filter.h"

namespace palpate {
namespace {

// 0, 0, 0 is a valid position, so a missing position must be an error.
Vec3 Required(bool has, const v1::Vector3& vector, const char* name) {
  if (!has) Refuse(std::string(name) + " is missing");
  return FromProto(vector);
}

DenseBlock BlockOf(const v1::DenseBlock& in) {
  static_assert(std::endian::native == std::endian::little, "as on the wire");
  const std::string& bytes = in.values();
  if (bytes.size() > kMostBlockBytes) {
    throw Error(ErrorKind::kTooLarge, "a block has at most 3 MiB of values: send it in parts");
  }
  if (bytes.size() % sizeof(float) != 0) {
    Refuse("the block's values are " + std::to_string(bytes.size()) +
           " bytes, which is not a multiple of 4 (float32)");
  }
  DenseBlock block;
  block.min = {in.min_x(), in.min_y(), in.min_z()};
  block.size = {in.size_x(), in.size_y(), in.size_z()};
  block.values.resize(bytes.size() / sizeof(float));
  if (!bytes.empty()) std::memcpy(block.values.data(), bytes.data(), bytes.size());
  return block;
}

SphereShape SphereOf(const v1::SphereShape& in) {
  return {Required(in.has_center(), in.center(), "sphere.center"), in.radius()};
}

BoxShape BoxOf(const v1::BoxShape& in) {
  return {Required(in.has_min(), in.min(), "box.min"), Required(in.has_max(), in.max(), "box.max")};
}

decltype(VolumeEdit::shape) ShapeOf(const v1::EditVolumeRequest& request) {
  switch (request.shape_case()) {
    case v1::EditVolumeRequest::kSphere:
      return SphereOf(request.sphere());
    case v1::EditVolumeRequest::kBox:
      return BoxOf(request.box());
    case v1::EditVolumeRequest::kCapsule: {
      const v1::CapsuleShape& in = request.capsule();
      return CapsuleShape{Required(in.has_from(), in.from(), "capsule.from"),
                          Required(in.has_to(), in.to(), "capsule.to"), in.radius()};
    }
    case v1::EditVolumeRequest::kBlock:
      return BlockOf(request.block());
    default:
      Refuse("the edit has no shape: give sphere, box, capsule or block");
  }
}

// Errors: kInvalidArgument; `what` says what to give.
template <class Enum>
Enum Known(int number, const char* what) {
  const Enum known = EnumeratorOf<Enum>(number);
  if (known == Enum::kUnknown)
    Refuse(fmt::format("{}: give {}", what, fmt::join(kWords<Enum>, " or ")));
  return known;
}

EditFrame FrameOf(const v1::EditVolumeRequest& request) {
  // A block always uses the index frame.
  if (request.frame() == v1::EDIT_FRAME_UNSPECIFIED && request.has_block()) {
    return EditFrame::kIndex;
  }
  return Known<EditFrame>(request.frame(), "the edit has no known frame");
}

// Numbers above the range of int are refused later, as too large.
int Int(std::uint32_t number) {
  return static_cast<int>(std::min<std::uint32_t>(number, std::numeric_limits<int>::max()));
}

// Throws Error: kInvalidArgument if the request has no shape, no operation or no position;
// kTooLarge for a block of too many bytes. The editor checks the numbers.
VolumeEdit EditOf(const v1::EditVolumeRequest& request) {
  VolumeEdit edit;
  edit.shape = ShapeOf(request);
  edit.frame = FrameOf(request);
  edit.operation = Known<EditOperation>(request.operation(), "the edit has no known operation");
  edit.value = request.value();
  if (request.has_strength()) edit.strength = request.strength();
  edit.falloff = request.falloff();
  return edit;
}

// Errors: as EditOf.
VolumeFilter FilterOf(const v1::FilterVolumeRequest& request) {
  VolumeFilter filter;
  filter.kind = Known<FilterKind>(request.kind(), "the filter has no known kind");
  if (request.has_width()) filter.width = Int(request.width());
  if (request.has_iterations()) filter.iterations = Int(request.iterations());
  filter.distance_mm = request.distance_mm();
  filter.spacing_mm = FromProto(request.spacing_mm());
  if (request.has_sphere()) filter.region = SphereOf(request.sphere());
  if (request.has_box()) filter.region = BoxOf(request.box());
  if (request.region_case() != v1::FilterVolumeRequest::REGION_NOT_SET) {
    filter.frame = Known<EditFrame>(request.frame(), "the filter has no known frame");
  }
  return filter;
}

v1::EditVolumeResponse ResponseOf(const EditOutcome& outcome, const AppliedTick& applied) {
  return ToProto(EditVolumeResponse{.volume_revision = outcome.volume_revision,
                                    .applied_tick = applied.tick,
                                    .changed = outcome.changed,
                                    .changed_voxels = outcome.changed_voxels,
                                    .undo_steps = static_cast<std::uint32_t>(outcome.undo_steps),
                                    .redo_steps = static_cast<std::uint32_t>(outcome.redo_steps)});
}

template <class Request>
VolumeEditor::Revision Expected(const Request& request) {
  if (!request.has_expected_revision()) return std::nullopt;
  return request.expected_revision();
}

}  // namespace

Reply* VolumeService::Change(CallContext* context, std::string_view method,
                             const google::protobuf::Message& request,
                             v1::EditVolumeResponse* response, const EditChange& change) {
  return calls_.Answer(context, method, request, *response, [=, this](const Admission& by) {
    const std::int64_t received_ns = MonotonicNowNs();
    const EditOutcome outcome = change([context] { return context->IsCancelled(); });
    if (outcome.changed_voxels > 0) by.Changed("voxels");
    const AppliedTick applied = editor_.Wait(outcome);
    metrics_.EditFelt(applied.time_ns - received_ns);
    *response = ResponseOf(outcome, applied);
  });
}

Reply* VolumeService::GetVolume(CallContext* context, const v1::GetVolumeRequest* request,
                                v1::GetVolumeResponse* response) {
  return calls_.Answer(context, "/palpate.v1.VolumeService/GetVolume", *request, *response,
                       [=, this](const Admission&) {
                         *response->mutable_volume() = ToProto(session_.shown().volume());
                       });
}

EventStream<v1::LoadVolumeResponse>* VolumeService::LoadVolume(
    CallContext* context, const v1::LoadVolumeRequest* request) {
  return calls_.Stream<v1::LoadVolumeResponse>(
      context, "/palpate.v1.VolumeService/LoadVolume",
      [=, this](auto& events, const auto& cancelled) {
        LoadRequest load = FromProto(*request);
        load.source = paths_.CheckLoad(request->source());
        load.title = request->source();  // as the client named it, without following links
        const VolumeState state =
            session_.Load(load, ProgressTo(events), cancelled, SettingsOf(*request));
        events.admission().Changed("volume");
        const AppliedTick applied = session_.WaitForServo(state.scene_revision);
        LogInfo("loaded {} (volume revision {}) at tick {}, isovalue {:g}", request->source(),
                state.volume->revision(), applied.tick, state.isovalue);
        v1::LoadVolumeResponse event;
        SetResult(session_, state, applied, *event.mutable_result());
        events.Send(std::move(event));
      });
}

VolumeStreamReactor* VolumeService::StreamVolume(CallContext* context) {
  Admission admission = calls_.access().Admit(context, "/palpate.v1.VolumeService/StreamVolume");
  if (!admission.ok()) {
    return new RefusedStream<v1::StreamVolumeRequest, v1::StreamVolumeResponse>(
        std::move(admission));
  }
  return StreamVolumeTo(streams_, std::move(admission));
}

Reply* VolumeService::EditVolume(CallContext* context, const v1::EditVolumeRequest* request,
                                 v1::EditVolumeResponse* response) {
  return Change(context, "/palpate.v1.VolumeService/EditVolume", *request, response,
                [=, this](const auto& cancelled) {
                  const Stroke stroke{.number = request->stroke(),
                                      .acts_once = request->stroke() != 0};
                  return editor_.Edit(EditOf(*request), Expected(*request), stroke, cancelled);
                });
}

EventStream<v1::FilterVolumeResponse>* VolumeService::FilterVolume(
    CallContext* context, const v1::FilterVolumeRequest* request) {
  return calls_.Stream<v1::FilterVolumeResponse>(
      context, "/palpate.v1.VolumeService/FilterVolume",
      [=, this](auto& events, const auto& cancelled) {
        const EditOutcome outcome =
            request->has_edit() ? editor_.Edit(EditOf(request->edit()), Expected(request->edit()),
                                               {}, cancelled, ProgressTo(events))
                                : filterer_.Filter(FilterOf(*request), Expected(*request),
                                                   ProgressTo(events), cancelled);
        if (outcome.changed_voxels > 0) events.admission().Changed("voxels");
        v1::FilterVolumeResponse event;
        *event.mutable_result() = ResponseOf(outcome, editor_.Wait(outcome));
        events.Send(std::move(event));
      });
}

Reply* VolumeService::UndoEdit(CallContext* context, const v1::UndoEditRequest* request,
                               v1::EditVolumeResponse* response) {
  return Change(
      context, "/palpate.v1.VolumeService/UndoEdit", *request, response,
      [=, this](const auto& cancelled) { return editor_.Undo(Expected(*request), cancelled); });
}

Reply* VolumeService::RedoEdit(CallContext* context, const v1::RedoEditRequest* request,
                               v1::EditVolumeResponse* response) {
  return Change(
      context, "/palpate.v1.VolumeService/RedoEdit", *request, response,
      [=, this](const auto& cancelled) { return editor_.Redo(Expected(*request), cancelled); });
}

Reply* VolumeService::RevertVolume(CallContext* context, const v1::RevertVolumeRequest* request,
                                   v1::EditVolumeResponse* response) {
  return Change(
      context, "/palpate.v1.VolumeService/RevertVolume", *request, response,
      [=, this](const auto& cancelled) { return editor_.Revert(Expected(*request), cancelled); });
}

void VolumeService::SaveTo(const v1::SaveVolumeRequest& request, const ExportProgress& progress,
                           const ExportCancelled& cancelled, v1::SaveVolumeResult& result) {
  // Two saves to one path would mix.
  const std::unique_lock saving(saving_, std::try_to_lock);
  if (!saving) {
    throw Error(ErrorKind::kConflict, "a volume is being saved: try again when it is done");
  }
  const auto volume = session_.volume().volume;
  const std::filesystem::path path = paths_.CheckSave(request.path());
  const MemoryClaim claim = session_.loader().budget->Claim("saving", ExportBytes(*volume, path));
  result.set_size_bytes(ExportVolume(
      *volume, {path, request.overwrite(), session_.loader().import_program}, progress, cancelled));
  session_.store().Saved(*volume);
  result.set_volume_revision(volume->revision());
}

EventStream<v1::SaveVolumeResponse>* VolumeService::SaveVolume(
    CallContext* context, const v1::SaveVolumeRequest* request) {
  return calls_.Stream<v1::SaveVolumeResponse>(
      context, "/palpate.v1.VolumeService/SaveVolume",
      [=, this](auto& events, const auto& cancelled) {
        v1::SaveVolumeResponse event;
        SaveTo(*request, ProgressTo(events), cancelled, *event.mutable_result());
        events.admission().MayHaveChanged("saved");
        LogInfo("saved volume revision {} to {} ({} bytes)", event.result().volume_revision(),
                request->path(), event.result().size_bytes());
        events.Send(std::move(event));
      });
}

// VolumeService::UploadVolume.

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
    Entrance::Of(*context_).threads().Run(kMethod, [this, ok] {
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
