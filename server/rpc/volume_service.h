// VolumeService: translates between the wire and the session.
#pragma once

#include "palpate/v1/volume.grpc.pb.h"
#include "server/session/path_policy.h"
#include "server/session/session.h"

namespace palpate {

class VolumeService final : public v1::VolumeService::Service {
 public:
  // Borrows all.
  VolumeService(Session& session, const PathPolicy& paths) : session_(session), paths_(paths) {}

  grpc::Status GetVolume(grpc::ServerContext* context, const v1::GetVolumeRequest* request,
                         v1::GetVolumeResponse* response) override;
  grpc::Status LoadVolume(grpc::ServerContext* context, const v1::LoadVolumeRequest* request,
                          grpc::ServerWriter<v1::LoadVolumeResponse>* writer) override;

 private:
  Session& session_;
  const PathPolicy& paths_;
};

}  // namespace palpate
