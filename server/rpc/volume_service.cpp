#include "server/rpc/volume_service.h"

#include <spdlog/spdlog.h>

#include "common/error/error.h"
#include "common/wire/convert.h"
#include "common/wire/status.h"

namespace palpate {
namespace {

v1::VolumeDescription ToProto(const VolumeState& state) {
  const VolumeMetadata& metadata = state.volume->metadata();
  v1::VolumeDescription out;
  out.set_source(metadata.source);
  out.set_volume_revision(state.volume->revision());
  out.set_size_x(static_cast<std::uint32_t>(metadata.size.x()));
  out.set_size_y(static_cast<std::uint32_t>(metadata.size.y()));
  out.set_size_z(static_cast<std::uint32_t>(metadata.size.z()));
  *out.mutable_spacing_mm() = palpate::ToProto(metadata.spacing_mm);
  out.set_value_min(metadata.value_min);
  out.set_value_max(metadata.value_max);
  out.set_unit(metadata.unit);
  out.set_original_type(metadata.original_type);
  *out.mutable_world_from_index() = palpate::ToProto(metadata.WorldFromIndex());
  *out.mutable_device_from_index() = palpate::ToProto(state.X_DI);
  out.set_device_mm_per_volume_mm(state.registration.device_mm_per_volume_mm);
  out.set_memory_bytes(state.volume->bricks().MemoryBytes());
  out.set_loaded_revision(state.volume->loaded_revision());
  out.set_frames(static_cast<std::uint32_t>(metadata.frames));
  return out;
}

LoadRequest FromProto(const v1::LoadVolumeRequest& request) {
  LoadRequest load;
  load.source = request.source();
  if (request.has_isovalue()) load.isovalue = request.isovalue();
  if (request.has_normalized_isovalue()) load.normalized_isovalue = request.normalized_isovalue();
  if (request.has_spacing_mm()) load.spacing_mm = palpate::FromProto(request.spacing_mm());
  if (request.has_device_mm_per_volume_mm()) {
    load.device_mm_per_volume_mm = request.device_mm_per_volume_mm();
  }
  return load;
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
