#include "server/rpc/volume_service.h"

#include <spdlog/spdlog.h>

#include "common/error/error.h"
#include "common/wire/status.h"
#include "server/rpc/volume_messages.h"

namespace palpate {

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

}  // namespace palpate
