// VolumeService: translates between the wire and the session.
#pragma once

#include "palpate/v1/volume.grpc.pb.h"
#include "server/rpc/volume_stream_service.h"
#include "server/session/path_policy.h"
#include "server/session/session.h"

namespace palpate {

class VolumeService final
    : public v1::VolumeService::WithCallbackMethod_StreamVolume<v1::VolumeService::Service> {
 public:
  // Borrows all.
  VolumeService(Session& session, const PathPolicy& paths, VolumeStreams& streams)
      : session_(session), paths_(paths), streams_(streams) {}

  grpc::Status GetVolume(grpc::ServerContext* context, const v1::GetVolumeRequest* request,
                         v1::GetVolumeResponse* response) override;
  grpc::Status LoadVolume(grpc::ServerContext* context, const v1::LoadVolumeRequest* request,
                          grpc::ServerWriter<v1::LoadVolumeResponse>* writer) override;

  VolumeStreamReactor* StreamVolume(grpc::CallbackServerContext*) override {
    return StreamVolumeTo(streams_);
  }

 private:
  Session& session_;
  const PathPolicy& paths_;
  VolumeStreams& streams_;
};

}  // namespace palpate
