#include "server/rpc/series_service.h"

#include <string>
#include <vector>

#include "common/error/error.h"
#include "common/wire/status.h"
#include "server/log/log.h"
#include "server/rpc/volume_messages.h"
#include "server/session/series_files.h"

namespace palpate {
namespace {

v1::SeriesState ToProto(const SeriesState& state) {
  v1::SeriesState out;
  out.set_frames(state.frames);
  out.set_position_frames(state.position_frames);
  out.set_playing(state.playing);
  out.set_rate_hz(state.rate_hz);
  out.set_loop(state.loop);
  out.set_interpolate(state.interpolate);
  out.set_memory_bytes(state.memory_bytes);
  out.set_volume_revision(state.volume_revision);
  return out;
}

SeriesControl ControlOf(const v1::ControlSeriesRequest& request) {
  SeriesControl control;
  if (request.has_playing()) control.playing = request.playing();
  if (request.has_position_frames()) control.position_frames = request.position_frames();
  if (request.has_rate_hz()) control.rate_hz = request.rate_hz();
  if (request.has_loop()) control.loop = request.loop();
  if (request.has_interpolate()) control.interpolate = request.interpolate();
  return control;
}

// The title in the volume's description.
std::string Title(const std::vector<std::string>& sources) {
  return sources.size() == 1 ? sources.front() : sources.front() + " ...";
}

}  // namespace

grpc::Status SeriesService::LoadSeries(grpc::ServerContext* context,
                                       const v1::LoadSeriesRequest* request,
                                       grpc::ServerWriter<v1::LoadSeriesResponse>* writer) {
  const Admission admission = access_.Admit(context, "/palpate.v1.SeriesService/LoadSeries");
  if (!admission.ok()) return admission.status();
  const auto progress = [&](std::string_view stage, double fraction) {
    v1::LoadSeriesResponse event;
    event.mutable_progress()->set_stage(std::string(stage));
    event.mutable_progress()->set_fraction(fraction);
    admission.Write(*writer, event);
  };
  const auto cancelled = [&] { return context->IsCancelled(); };
  try {
    const std::vector<std::string> sources(request->sources().begin(), request->sources().end());
    const auto files = FindSeriesFiles(sources, paths_);
    LoadRequest load = FromProto(request->options());
    load.title = Title(sources);
    const VolumeState state = player_.Load(files, load, progress, cancelled);
    const AppliedTick applied = session_.WaitForServo(state.scene_revision);
    v1::LoadSeriesResponse event;
    *event.mutable_result()->mutable_volume() = palpate::ToProto(state);
    *event.mutable_result()->mutable_series() = ToProto(player_.state());
    admission.Write(*writer, event);
    LogInfo("loaded a series of {} frames, {} (volume revision {}) at tick {}",
            event.result().series().frames(), load.title, state.volume->revision(), applied.tick);
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return admission.Failed(error);
  }
}

grpc::Status SeriesService::GetSeries(grpc::ServerContext* context, const v1::GetSeriesRequest*,
                                      v1::GetSeriesResponse* response) {
  const Admission admission = access_.Admit(context, "/palpate.v1.SeriesService/GetSeries");
  if (!admission.ok()) return admission.status();
  try {
    *response->mutable_series() = ToProto(player_.state());
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return ToStatus(error);
  }
}

grpc::Status SeriesService::ControlSeries(grpc::ServerContext* context,
                                          const v1::ControlSeriesRequest* request,
                                          v1::ControlSeriesResponse* response) {
  const Admission admission = access_.Admit(context, "/palpate.v1.SeriesService/ControlSeries");
  if (!admission.ok()) return admission.status();
  try {
    *response->mutable_series() = ToProto(player_.Control(ControlOf(*request)));
    return grpc::Status::OK;
  } catch (const std::exception& error) {
    return ToStatus(error);
  }
}

}  // namespace palpate
