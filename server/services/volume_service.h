// VolumeService: translates between messages and the session.
#pragma once

#include <functional>
#include <mutex>
#include <string_view>

#include "palpate/v1/volume.grpc.pb.h"
#include "server/client_paths/path_policy.h"
#include "server/client_paths/upload.h"
#include "server/metrics/service_metrics.h"
#include "server/services/calls.h"
#include "server/services/volume_stream_service.h"
#include "server/session/edits/volume_editor.h"
#include "server/session/edits/volume_filterer.h"
#include "server/session/session.h"
#include "server/volume/save/volume_export.h"

namespace palpate {

class VolumeService final : public v1::VolumeService::CallbackService {
 public:
  // Borrows all arguments.
  VolumeService(Calls& calls, Session& session, VolumeEditor& editor, const PathPolicy& paths,
                const UploadOptions& uploads, VolumeStreams& streams, ServiceMetrics& metrics)
      : calls_(calls),
        session_(session),
        editor_(editor),
        filterer_(session, editor),
        paths_(paths),
        uploads_(uploads),
        streams_(streams),
        metrics_(metrics) {}

  Reply* GetVolume(CallContext* context, const v1::GetVolumeRequest* request,
                   v1::GetVolumeResponse* response) override;
  EventStream<v1::LoadVolumeResponse>* LoadVolume(CallContext* context,
                                                  const v1::LoadVolumeRequest* request) override;
  Reply* EditVolume(CallContext* context, const v1::EditVolumeRequest* request,
                    v1::EditVolumeResponse* response) override;
  EventStream<v1::FilterVolumeResponse>* FilterVolume(
      CallContext* context, const v1::FilterVolumeRequest* request) override;
  Reply* UndoEdit(CallContext* context, const v1::UndoEditRequest* request,
                  v1::EditVolumeResponse* response) override;
  Reply* RedoEdit(CallContext* context, const v1::RedoEditRequest* request,
                  v1::EditVolumeResponse* response) override;
  Reply* RevertVolume(CallContext* context, const v1::RevertVolumeRequest* request,
                      v1::EditVolumeResponse* response) override;
  EventStream<v1::SaveVolumeResponse>* SaveVolume(CallContext* context,
                                                  const v1::SaveVolumeRequest* request) override;

  VolumeStreamReactor* StreamVolume(CallContext* context) override;

  grpc::ServerReadReactor<v1::UploadVolumeRequest>* UploadVolume(
      CallContext* context, v1::UploadVolumeResponse* response) override;

 private:
  class Uploading;
  // Makes the change and answers when the servo has used it.
  using EditChange = std::function<EditOutcome(const Calls::Cancelled& cancelled)>;
  Reply* Change(CallContext* context, std::string_view method,
                const google::protobuf::Message& request, v1::EditVolumeResponse* response,
                const EditChange& change);
  // Throws Error: kConflict while another save runs, kPermissionDenied, and all of ExportVolume.
  void SaveTo(const v1::SaveVolumeRequest& request, const ExportProgress& progress,
              const ExportCancelled& cancelled, v1::SaveVolumeResult& result);
  VolumeState LoadUpload(const Upload& upload, LoadRequest request, const SettingsUpdate& settings,
                         const LoadCancelled& cancelled);

  Calls& calls_;
  Session& session_;
  VolumeEditor& editor_;
  VolumeFilterer filterer_;
  std::mutex saving_;
  const PathPolicy& paths_;
  const UploadOptions& uploads_;
  VolumeStreams& streams_;
  ServiceMetrics& metrics_;
};

}  // namespace palpate
