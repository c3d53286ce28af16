// RecordingService: translates between messages and the session's recordings.
#pragma once

#include "palpate/v1/recording.grpc.pb.h"
#include "server/recording/recording_control.h"
#include "server/services/calls.h"
#include "server/session/edits/volume_editor.h"

namespace palpate {

v1::RecordingState ToProto(const RecordingStatus& status);

class RecordingService final : public v1::RecordingService::CallbackService {
 public:
  // Borrows all.
  RecordingService(Calls& calls, RecordingControl& control, const VolumeEditor& editor)
      : calls_(calls), control_(control), editor_(editor) {}

  Reply* StartRecording(CallContext* context, const v1::StartRecordingRequest* request,
                        v1::StartRecordingResponse* response) override;
  Reply* StopRecording(CallContext* context, const v1::StopRecordingRequest* request,
                       v1::StopRecordingResponse* response) override;
  Reply* GetRecording(CallContext* context, const v1::GetRecordingRequest* request,
                      v1::GetRecordingResponse* response) override;
  Reply* Mark(CallContext* context, const v1::MarkRequest* request,
              v1::MarkResponse* response) override;
  Reply* ListRecordings(CallContext* context, const v1::ListRecordingsRequest* request,
                        v1::ListRecordingsResponse* response) override;
  EventStream<v1::ReplayResponse>* Replay(CallContext* context,
                                          const v1::ReplayRequest* request) override;

 private:
  Calls& calls_;
  RecordingControl& control_;
  const VolumeEditor& editor_;
};

}  // namespace palpate
