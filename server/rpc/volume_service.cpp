#include "server/rpc/volume_service.h"

#include <spdlog/spdlog.h>

#include "common/error/error.h"
#include "common/wire/status.h"
#include "server/rpc/volume_edit.h"
#include "server/rpc/volume_messages.h"

namespace palpate {
namespace {

// Makes the change and answers when the servo has used it.
template <class Change>
grpc::Status Answer(VolumeEditor& editor, v1::EditVolumeResponse* response, const Change& change) {
  try {
    const EditOutcome outcome = change();
    *response = ToProto(outcome, editor.Wait(outcome));
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return ToStatus(error);
  }
}

template <class Request>
VolumeEditor::Revision Expected(const Request& request) {
  if (!request.has_expected_revision()) return std::nullopt;
  return request.expected_revision();
}

}  // namespace

grpc::Status VolumeService::GetVolume(grpc::ServerContext*, const v1::GetVolumeRequest*,
                                      v1::GetVolumeResponse* response) {
  *response->mutable_volume() = ToProto(session_.volume());
  return grpc::Status::OK;
}

grpc::Status VolumeService::LoadVolume(grpc::ServerContext* context,
                                       const v1::LoadVolumeRequest* request,
                                       grpc::ServerWriter<v1::LoadVolumeResponse>* writer) {
  const auto progress = [&](std::string_view stage, double fraction) {
    v1::LoadVolumeResponse event;
    event.mutable_progress()->set_stage(std::string(stage));
    event.mutable_progress()->set_fraction(fraction);
    writer->Write(event);
  };
  const auto cancelled = [&] { return context->IsCancelled(); };
  try {
    LoadRequest load = FromProto(*request);
    load.source = paths_.CheckLoad(request->source());
    load.title = request->source();  // as it was asked for, links not followed
    AppliedTick applied;
    const VolumeState state = session_.LoadAndWait(load, progress, cancelled, applied);
    v1::LoadVolumeResponse event;
    *event.mutable_result()->mutable_volume() = ToProto(state);
    event.mutable_result()->set_applied_tick(applied.tick);
    event.mutable_result()->set_settings_revision(state.settings_revision);
    writer->Write(event);
    spdlog::info("loaded {} (volume revision {}) at tick {}", request->source(),
                 state.volume->revision(), applied.tick);
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    spdlog::warn("load of {} failed: {}", request->source(), error.what());
    return ToStatus(error);
  }
}

grpc::Status VolumeService::EditVolume(grpc::ServerContext*, const v1::EditVolumeRequest* request,
                                       v1::EditVolumeResponse* response) {
  return Answer(editor_, response,
                [&] { return editor_.Edit(FromProto(*request), Expected(*request)); });
}

grpc::Status VolumeService::UndoEdit(grpc::ServerContext*, const v1::UndoEditRequest* request,
                                     v1::EditVolumeResponse* response) {
  return Answer(editor_, response, [&] { return editor_.Undo(Expected(*request)); });
}

grpc::Status VolumeService::RedoEdit(grpc::ServerContext*, const v1::RedoEditRequest* request,
                                     v1::EditVolumeResponse* response) {
  return Answer(editor_, response, [&] { return editor_.Redo(Expected(*request)); });
}

grpc::Status VolumeService::RevertVolume(grpc::ServerContext*,
                                         const v1::RevertVolumeRequest* request,
                                         v1::EditVolumeResponse* response) {
  return Answer(editor_, response, [&] { return editor_.Revert(Expected(*request)); });
}

grpc::Status VolumeService::SaveVolume(grpc::ServerContext* context,
                                       const v1::SaveVolumeRequest* request,
                                       grpc::ServerWriter<v1::SaveVolumeResponse>* writer) {
  return saver_.Save(context, *request, writer);
}

}  // namespace palpate
