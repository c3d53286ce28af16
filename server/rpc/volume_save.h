// SaveVolume: saves the present volume to a file.
//
// Threads: any; one save at a time, others are refused.
#pragma once

#include <filesystem>
#include <functional>
#include <mutex>
#include <string>

#include "palpate/v1/volume.grpc.pb.h"
#include "server/rpc/access.h"
#include "server/session/session.h"

namespace palpate {

// Returns the path to write for a path that a client names. Throws Error (kPermissionDenied) if the
// client must not write there.
using SavePathCheck = std::function<std::filesystem::path(const std::string& path)>;

class VolumeSaver {
 public:
  VolumeSaver(Session& session, SavePathCheck check)
      : session_(session), check_(std::move(check)) {}

  // Implements VolumeService.SaveVolume.
  grpc::Status Save(grpc::ServerContext* context, const Admission& admission,
                    const v1::SaveVolumeRequest& request,
                    grpc::ServerWriter<v1::SaveVolumeResponse>* writer);

 private:
  v1::SaveVolumeResult SaveChecked(grpc::ServerContext* context, const Admission& admission,
                                   const v1::SaveVolumeRequest& request,
                                   grpc::ServerWriter<v1::SaveVolumeResponse>* writer);

  Session& session_;
  const SavePathCheck check_;
  std::mutex saving_;
};

}  // namespace palpate
