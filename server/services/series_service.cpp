#include "server/services/series_service.h"

#include <string>
#include <vector>

#include "common/error/error.h"
#include "common/wire/status.h"
#include "common/wire/values.h"
#include "server/client_paths/series_files.h"
#include "server/log/log.h"
#include "server/services/volume_messages.h"

namespace palpate {
namespace {

// The title in the volume's description.
std::string Title(const std::vector<std::string>& sources) {
  return sources.size() == 1 ? sources.front() : sources.front() + " ...";
}

}  // namespace

EventStream<v1::LoadSeriesResponse>* SeriesService::LoadSeries(
    CallContext* context, const v1::LoadSeriesRequest* request) {
  return calls_.Stream<v1::LoadSeriesResponse>(
      context, "/palpate.v1.SeriesService/LoadSeries",
      [=, this](auto& events, const auto& cancelled) {
        const std::vector<std::string> sources(request->sources().begin(),
                                               request->sources().end());
        const auto files = FindSeriesFiles(sources, paths_);
        LoadRequest load = FromProto(request->options());
        load.title = Title(sources);
        const VolumeState state = player_.Load(files, load, ProgressTo(events), cancelled,
                                               SettingsOf(request->options()));
        events.admission().Changed("volume");
        const AppliedTick applied = session_.WaitForServo(state.scene_revision);
        v1::LoadSeriesResponse event;
        SetResult(session_, state, applied, *event.mutable_result());
        *event.mutable_result()->mutable_series() = ToProto(player_.state());
        LogInfo("loaded a series of {} frames, {} (volume revision {}) at tick {}",
                event.result().series().frames(), load.title, state.volume->revision(),
                applied.tick);
        events.Send(std::move(event));
      });
}

Reply* SeriesService::GetSeries(CallContext* context, const v1::GetSeriesRequest* request,
                                v1::GetSeriesResponse* response) {
  return calls_.Answer(
      context, "/palpate.v1.SeriesService/GetSeries", *request, *response,
      [=, this](const Admission&) { *response->mutable_series() = ToProto(player_.state()); });
}

Reply* SeriesService::ControlSeries(CallContext* context, const v1::ControlSeriesRequest* request,
                                    v1::ControlSeriesResponse* response) {
  return calls_.Answer(
      context, "/palpate.v1.SeriesService/ControlSeries", *request, *response,
      [=, this](const Admission& by) {
        const SeriesControlled controlled = player_.Control(FromProto(*request));
        by.Changed("series");
        response->set_applied_tick(session_.WaitForServo(controlled.scene_revision).tick);
        *response->mutable_series() = ToProto(controlled.series);
      });
}

}  // namespace palpate
