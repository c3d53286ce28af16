#include "server/rpc/volume_service.h"

#include "common/error/error.h"
#include "common/wire/status.h"
#include "server/log/log.h"
#include "server/realtime/tick_timer.h"
#include "server/rpc/volume_edit.h"
#include "server/rpc/volume_messages.h"
#include "server/volume/edit.h"

namespace palpate {
namespace {

template <class Request>
VolumeEditor::Revision Expected(const Request& request) {
  if (!request.has_expected_revision()) return std::nullopt;
  return request.expected_revision();
}

VolumeEditor::Cancelled Cancelled(grpc::ServerContext* context) {
  return [context] { return context->IsCancelled(); };
}

}  // namespace

template <class Change>
grpc::Status VolumeService::Answer(v1::EditVolumeResponse* response, const Change& change) {
  const std::int64_t received_ns = MonotonicNowNs();
  try {
    const EditOutcome outcome = change();
    const AppliedTick applied = editor_.Wait(outcome);
    metrics_.EditFelt(applied.time_ns - received_ns);
    *response = ToProto(outcome, applied);
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return ToStatus(error);
  }
}

grpc::Status VolumeService::GetVolume(grpc::ServerContext* context, const v1::GetVolumeRequest*,
                                      v1::GetVolumeResponse* response) {
  const Admission admission = access_.Admit(context, "/palpate.v1.VolumeService/GetVolume");
  if (!admission.ok()) return admission.status();
  *response->mutable_volume() = ToProto(session_.volume());
  return grpc::Status::OK;
}

grpc::Status VolumeService::LoadVolume(grpc::ServerContext* context,
                                       const v1::LoadVolumeRequest* request,
                                       grpc::ServerWriter<v1::LoadVolumeResponse>* writer) {
  const Admission admission = access_.Admit(context, "/palpate.v1.VolumeService/LoadVolume");
  if (!admission.ok()) return admission.status();
  const auto progress = [&](std::string_view stage, double fraction) {
    v1::LoadVolumeResponse event;
    event.mutable_progress()->set_stage(std::string(stage));
    event.mutable_progress()->set_fraction(fraction);
    admission.Write(*writer, event);
  };
  const auto cancelled = [&] { return context->IsCancelled(); };
  try {
    LoadRequest load = FromProto(*request);
    load.source = paths_.CheckLoad(request->source());
    load.title = request->source();  // as the client named it, without following links
    AppliedTick applied;
    const VolumeState state = session_.LoadAndWait(load, progress, cancelled, applied);
    v1::LoadVolumeResponse event;
    *event.mutable_result()->mutable_volume() = ToProto(state);
    event.mutable_result()->set_applied_tick(applied.tick);
    event.mutable_result()->set_settings_revision(state.settings_revision);
    admission.Write(*writer, event);
    LogInfo("loaded {} (volume revision {}) at tick {}", request->source(),
            state.volume->revision(), applied.tick);
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return admission.Failed(error);
  }
}

VolumeStreamReactor* VolumeService::StreamVolume(grpc::CallbackServerContext* context) {
  Admission admission = access_.Admit(context, "/palpate.v1.VolumeService/StreamVolume");
  if (!admission.ok()) {
    return new RefusedStream<v1::StreamVolumeRequest, v1::StreamVolumeResponse>(admission.status());
  }
  return StreamVolumeTo(streams_, std::move(admission));
}

grpc::Status VolumeService::EditVolume(grpc::ServerContext* context,
                                       const v1::EditVolumeRequest* request,
                                       v1::EditVolumeResponse* response) {
  const Admission admission = access_.Admit(context, "/palpate.v1.VolumeService/EditVolume");
  if (!admission.ok()) return admission.status();
  return Answer(response, [&] {
    const VolumeEdit edit = FromProto(*request);
    return editor_.Edit(edit, Expected(*request), 0, Cancelled(context));
  });
}

grpc::Status VolumeService::FilterVolume(grpc::ServerContext* context,
                                         const v1::FilterVolumeRequest* request,
                                         grpc::ServerWriter<v1::FilterVolumeResponse>* writer) {
  const Admission admission = access_.Admit(context, "/palpate.v1.VolumeService/FilterVolume");
  if (!admission.ok()) return admission.status();
  const auto progress = [&](std::string_view stage, double fraction) {
    v1::FilterVolumeResponse event;
    event.mutable_progress()->set_stage(std::string(stage));
    event.mutable_progress()->set_fraction(fraction);
    admission.Write(*writer, event);
  };
  const auto cancelled = [&] { return context->IsCancelled(); };
  try {
    const EditOutcome outcome =
        filterer_.Filter(FromProto(*request), Expected(*request), progress, cancelled);
    v1::FilterVolumeResponse event;
    *event.mutable_result() = ToProto(outcome, editor_.Wait(outcome));
    admission.Write(*writer, event);
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return admission.Failed(error);
  }
}

grpc::Status VolumeService::UndoEdit(grpc::ServerContext* context,
                                     const v1::UndoEditRequest* request,
                                     v1::EditVolumeResponse* response) {
  const Admission admission = access_.Admit(context, "/palpate.v1.VolumeService/UndoEdit");
  if (!admission.ok()) return admission.status();
  return Answer(response, [&] { return editor_.Undo(Expected(*request), Cancelled(context)); });
}

grpc::Status VolumeService::RedoEdit(grpc::ServerContext* context,
                                     const v1::RedoEditRequest* request,
                                     v1::EditVolumeResponse* response) {
  const Admission admission = access_.Admit(context, "/palpate.v1.VolumeService/RedoEdit");
  if (!admission.ok()) return admission.status();
  return Answer(response, [&] { return editor_.Redo(Expected(*request), Cancelled(context)); });
}

grpc::Status VolumeService::RevertVolume(grpc::ServerContext* context,
                                         const v1::RevertVolumeRequest* request,
                                         v1::EditVolumeResponse* response) {
  const Admission admission = access_.Admit(context, "/palpate.v1.VolumeService/RevertVolume");
  if (!admission.ok()) return admission.status();
  return Answer(response, [&] { return editor_.Revert(Expected(*request), Cancelled(context)); });
}

grpc::Status VolumeService::SaveVolume(grpc::ServerContext* context,
                                       const v1::SaveVolumeRequest* request,
                                       grpc::ServerWriter<v1::SaveVolumeResponse>* writer) {
  const Admission admission = access_.Admit(context, "/palpate.v1.VolumeService/SaveVolume");
  if (!admission.ok()) return admission.status();
  return saver_.Save(context, admission, *request, writer);
}

}  // namespace palpate
