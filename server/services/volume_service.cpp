#include "server/services/volume_service.h"

#include "common/error/error.h"
#include "common/wire/status.h"
#include "server/log/log.h"
#include "server/realtime/tick_timer.h"
#include "server/services/volume_edit.h"
#include "server/services/volume_messages.h"
#include "server/volume/edit/edit.h"

namespace palpate {
namespace {

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
    *response = ToProto(outcome, applied);
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
                  return editor_.Edit(FromProto(*request), Expected(*request), stroke, cancelled);
                });
}

EventStream<v1::FilterVolumeResponse>* VolumeService::FilterVolume(
    CallContext* context, const v1::FilterVolumeRequest* request) {
  return calls_.Stream<v1::FilterVolumeResponse>(
      context, "/palpate.v1.VolumeService/FilterVolume",
      [=, this](auto& events, const auto& cancelled) {
        const EditOutcome outcome =
            request->has_edit()
                ? editor_.Edit(FromProto(request->edit()), Expected(request->edit()), {}, cancelled,
                               ProgressTo(events))
                : filterer_.Filter(FromProto(*request), Expected(*request), ProgressTo(events),
                                   cancelled);
        if (outcome.changed_voxels > 0) events.admission().Changed("voxels");
        v1::FilterVolumeResponse event;
        *event.mutable_result() = ToProto(outcome, editor_.Wait(outcome));
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

}  // namespace palpate
