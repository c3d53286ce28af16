#include "server/services/recording_service.h"

#include <utility>

#include "common/contract/recording.h"
#include "common/error/error.h"
#include "common/wire/status.h"
#include "common/wire/values.h"
#include "server/log/log.h"

namespace palpate {

v1::RecordingState ToProto(const RecordingStatus& status) {
  return palpate::ToProto(
      RecordingState{.running = status.running,
                     .path = status.path,
                     .ticks = status.counts.ticks,
                     .lost_ticks = status.counts.lost_ticks,
                     .size_bytes = status.counts.bytes,
                     .error = status.error ? status.error->what() : "",
                     .left_out = status.left_out,
                     .replay = status.replay,
                     .disk_full = status.error && status.error->kind() == ErrorKind::kDiskFull});
}

namespace {

v1::ReplayResponse ToProto(const ReplayReport& report) {
  return palpate::ToProto(ReplayResponse{.ticks = report.state.ticks,
                                         .lost_ticks = report.state.lost_ticks,
                                         .marker = report.state.marker,
                                         .total_ticks = report.total_ticks,
                                         .markers = report.markers});
}

}  // namespace

Reply* RecordingService::StartRecording(CallContext* context,
                                        const v1::StartRecordingRequest* request,
                                        v1::StartRecordingResponse* response) {
  return calls_.Answer(context, "/palpate.v1.RecordingService/StartRecording", *request, *response,
                       [=, this](const Admission& by) {
                         const RecordingStatus status =
                             control_.Start(request->path(), request->overwrite());
                         by.Changed("recording");
                         LogInfo("recording to {}", status.path);
                         *response->mutable_recording() = ToProto(status);
                       });
}

Reply* RecordingService::StopRecording(CallContext* context,
                                       const v1::StopRecordingRequest* request,
                                       v1::StopRecordingResponse* response) {
  return calls_.Answer(
      context, "/palpate.v1.RecordingService/StopRecording", *request, *response,
      [=, this](const Admission& by) {
        const RecordingStatus status = control_.Stop();
        by.Changed("recording");
        if (status.error) {
          LogWarning("recording to {} had ended: {}", status.path, status.error->what());
        } else {
          LogInfo("recorded {} ticks to {}, {} lost, {} bytes", status.counts.ticks, status.path,
                  status.counts.lost_ticks, status.counts.bytes);
        }
        *response->mutable_recording() = ToProto(status);
      });
}

Reply* RecordingService::GetRecording(CallContext* context, const v1::GetRecordingRequest* request,
                                      v1::GetRecordingResponse* response) {
  return calls_.Answer(
      context, "/palpate.v1.RecordingService/GetRecording", *request, *response,
      [=, this](const Admission&) { *response->mutable_recording() = ToProto(control_.status()); });
}

Reply* RecordingService::Mark(CallContext* context, const v1::MarkRequest* request,
                              v1::MarkResponse* response) {
  return calls_.Answer(
      context, "/palpate.v1.RecordingService/Mark", *request, *response,
      [=, this](const Admission&) { response->set_time_ns(control_.Mark(request->text())); });
}

Reply* RecordingService::ListRecordings(CallContext* context,
                                        const v1::ListRecordingsRequest* request,
                                        v1::ListRecordingsResponse* response) {
  return calls_.Answer(
      context, "/palpate.v1.RecordingService/ListRecordings", *request, *response,
      [=, this](const Admission&) {
        for (const ListedRecording& recording : control_.Recordings()) {
          *response->add_recordings() = palpate::ToProto(
              RecordedFile{recording.path.string(), recording.size_bytes, recording.modified_s});
        }
        response->set_folder(control_.folder().string());
      });
}

EventStream<v1::ReplayResponse>* RecordingService::Replay(CallContext* context,
                                                          const v1::ReplayRequest* request) {
  return calls_.Stream<v1::ReplayResponse>(
      context, "/palpate.v1.RecordingService/Replay",
      [=, this](auto& events, const auto& cancelled) {
        std::uint64_t ticks = 0;
        bool is_logged = false;
        const auto report = [&](const ReplayReport& now) {
          // Only now the path is known to be allowed.
          if (!std::exchange(is_logged, true)) {
            LogInfo("replaying {} to viewers, from tick {}, by {}", request->path(),
                    request->first_tick(), events.admission().Who());
          }
          ticks = now.state.ticks;
          events.Send(ToProto(now));
        };
        const ViewerReplayOptions options = {
            .speed = request->speed() == 0.0 ? 1.0 : request->speed(),
            .first_tick = request->first_tick(),
            .by = events.admission().Who(),
            .as_loaded = [this] { return editor_.AsLoaded(); }};
        control_.Replay(request->path(), options, report, cancelled);
        LogInfo("replayed {} to tick {}", request->path(), ticks);
      });
}

}  // namespace palpate
