#include "server/rpc/recording_service.h"

#include "common/error/error.h"
#include "common/wire/status.h"
#include "server/log/log.h"

namespace palpate {
namespace {

v1::RecordingState ToProto(const RecordingStatus& status) {
  v1::RecordingState out;
  out.set_running(status.running);
  out.set_path(status.path);
  out.set_ticks(status.counts.ticks);
  out.set_lost_ticks(status.counts.lost_ticks);
  out.set_size_bytes(status.counts.bytes);
  if (status.error) {
    out.set_error(status.error->what());
    out.set_disk_full(status.error->kind() == ErrorKind::kDiskFull);
  }
  out.set_left_out(status.left_out);
  return out;
}

}  // namespace

grpc::Status RecordingService::StartRecording(grpc::ServerContext* context,
                                              const v1::StartRecordingRequest* request,
                                              v1::StartRecordingResponse* response) {
  const Admission admission = access_.Admit(context, "/palpate.v1.RecordingService/StartRecording");
  if (!admission.ok()) return admission.status();
  try {
    const RecordingStatus status = control_.Start(request->path(), request->overwrite());
    LogInfo("recording to {}", status.path);
    *response->mutable_recording() = ToProto(status);
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return admission.Failed(error);
  }
}

grpc::Status RecordingService::StopRecording(grpc::ServerContext* context,
                                             const v1::StopRecordingRequest*,
                                             v1::StopRecordingResponse* response) {
  const Admission admission = access_.Admit(context, "/palpate.v1.RecordingService/StopRecording");
  if (!admission.ok()) return admission.status();
  try {
    const RecordingStatus status = control_.Stop();
    if (status.error) {
      LogWarning("recording to {} had ended: {}", status.path, status.error->what());
    } else {
      LogInfo("recorded {} ticks to {}, {} lost, {} bytes", status.counts.ticks, status.path,
              status.counts.lost_ticks, status.counts.bytes);
    }
    *response->mutable_recording() = ToProto(status);
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return ToStatus(error);
  }
}

grpc::Status RecordingService::GetRecording(grpc::ServerContext* context,
                                            const v1::GetRecordingRequest*,
                                            v1::GetRecordingResponse* response) {
  const Admission admission = access_.Admit(context, "/palpate.v1.RecordingService/GetRecording");
  if (!admission.ok()) return admission.status();
  *response->mutable_recording() = ToProto(control_.status());
  return grpc::Status::OK;
}

grpc::Status RecordingService::Mark(grpc::ServerContext* context, const v1::MarkRequest* request,
                                    v1::MarkResponse* response) {
  const Admission admission = access_.Admit(context, "/palpate.v1.RecordingService/Mark");
  if (!admission.ok()) return admission.status();
  try {
    response->set_time_ns(control_.Mark(request->text()));
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return ToStatus(error);
  }
}

grpc::Status RecordingService::Replay(grpc::ServerContext* context,
                                      const v1::ReplayRequest* request,
                                      grpc::ServerWriter<v1::ReplayResponse>* writer) {
  const Admission admission = access_.Admit(context, "/palpate.v1.RecordingService/Replay");
  if (!admission.ok()) return admission.status();
  std::uint64_t ticks = 0;
  const auto progress = [&](const ViewerReplayState& state) {
    ticks = state.ticks;
    v1::ReplayResponse event;
    event.set_ticks(state.ticks);
    event.set_lost_ticks(state.lost_ticks);
    event.set_marker(state.marker);
    admission.Write(*writer, event);
  };
  const auto cancelled = [&] { return context->IsCancelled(); };
  try {
    LogInfo("replaying {} to viewers", request->path());
    control_.Replay(request->path(), request->speed() == 0.0 ? 1.0 : request->speed(), progress,
                    cancelled);
    LogInfo("replayed {} ticks of {}", ticks, request->path());
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return admission.Failed(error);
  }
}

}  // namespace palpate
