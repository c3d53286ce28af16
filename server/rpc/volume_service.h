// VolumeService: translates between messages and the session.
#pragma once

#include "palpate/v1/volume.grpc.pb.h"
#include "server/metrics/service_metrics.h"
#include "server/rpc/access.h"
#include "server/rpc/volume_save.h"
#include "server/rpc/volume_stream_service.h"
#include "server/session/path_policy.h"
#include "server/session/session.h"
#include "server/session/upload.h"
#include "server/session/volume_editor.h"
#include "server/session/volume_filterer.h"

namespace palpate {

class VolumeService final
    : public v1::VolumeService::WithCallbackMethod_StreamVolume<v1::VolumeService::Service> {
 public:
  // Borrows all arguments.
  VolumeService(Access& access, Session& session, VolumeEditor& editor, const PathPolicy& paths,
                const UploadOptions& uploads, VolumeStreams& streams, ServiceMetrics& metrics)
      : access_(access),
        session_(session),
        editor_(editor),
        filterer_(session, editor),
        saver_(session, [&paths](const std::string& path) { return paths.CheckSave(path); }),
        paths_(paths),
        uploads_(uploads),
        streams_(streams),
        metrics_(metrics) {}

  grpc::Status GetVolume(grpc::ServerContext* context, const v1::GetVolumeRequest* request,
                         v1::GetVolumeResponse* response) override;
  grpc::Status LoadVolume(grpc::ServerContext* context, const v1::LoadVolumeRequest* request,
                          grpc::ServerWriter<v1::LoadVolumeResponse>* writer) override;
  grpc::Status EditVolume(grpc::ServerContext* context, const v1::EditVolumeRequest* request,
                          v1::EditVolumeResponse* response) override;
  grpc::Status FilterVolume(grpc::ServerContext* context, const v1::FilterVolumeRequest* request,
                            grpc::ServerWriter<v1::FilterVolumeResponse>* writer) override;
  grpc::Status UndoEdit(grpc::ServerContext* context, const v1::UndoEditRequest* request,
                        v1::EditVolumeResponse* response) override;
  grpc::Status RedoEdit(grpc::ServerContext* context, const v1::RedoEditRequest* request,
                        v1::EditVolumeResponse* response) override;
  grpc::Status RevertVolume(grpc::ServerContext* context, const v1::RevertVolumeRequest* request,
                            v1::EditVolumeResponse* response) override;
  grpc::Status SaveVolume(grpc::ServerContext* context, const v1::SaveVolumeRequest* request,
                          grpc::ServerWriter<v1::SaveVolumeResponse>* writer) override;

  VolumeStreamReactor* StreamVolume(grpc::CallbackServerContext* context) override;

  grpc::Status UploadVolume(grpc::ServerContext* context,
                            grpc::ServerReader<v1::UploadVolumeRequest>* reader,
                            v1::UploadVolumeResponse* response) override;

 private:
  // Makes the change and answers when the servo has used it.
  template <class Change>
  grpc::Status Answer(v1::EditVolumeResponse* response, const Change& change);
  VolumeState LoadUpload(const Upload& upload, LoadRequest request, const LoadCancelled& cancelled,
                         AppliedTick& applied);

  Access& access_;
  Session& session_;
  VolumeEditor& editor_;
  VolumeFilterer filterer_;
  VolumeSaver saver_;
  const PathPolicy& paths_;
  const UploadOptions& uploads_;
  VolumeStreams& streams_;
  ServiceMetrics& metrics_;
};

}  // namespace palpate
