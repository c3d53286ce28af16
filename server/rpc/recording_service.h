// RecordingService: translates between messages and the session's recordings.
#pragma once

#include "palpate/v1/recording.grpc.pb.h"
#include "server/recording/recording_control.h"
#include "server/rpc/access.h"

namespace palpate {

class RecordingService final : public v1::RecordingService::Service {
 public:
  // Borrows both.
  RecordingService(Access& access, RecordingControl& control)
      : access_(access), control_(control) {}

  grpc::Status StartRecording(grpc::ServerContext* context,
                              const v1::StartRecordingRequest* request,
                              v1::StartRecordingResponse* response) override;
  grpc::Status StopRecording(grpc::ServerContext* context, const v1::StopRecordingRequest* request,
                             v1::StopRecordingResponse* response) override;
  grpc::Status GetRecording(grpc::ServerContext* context, const v1::GetRecordingRequest* request,
                            v1::GetRecordingResponse* response) override;
  grpc::Status Mark(grpc::ServerContext* context, const v1::MarkRequest* request,
                    v1::MarkResponse* response) override;
  grpc::Status Replay(grpc::ServerContext* context, const v1::ReplayRequest* request,
                      grpc::ServerWriter<v1::ReplayResponse>* writer) override;

 private:
  Access& access_;
  RecordingControl& control_;
};

}  // namespace palpate
