// The gRPC server: services, health, reflection, and where it listens.
//
// Threads: construct, Start and Stop on the main thread.
// Errors: Error with what is wrong and what to do.
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <optional>
#include <string>

#include "common/wire/address.h"
#include "server/rpc/device_service.h"
#include "server/rpc/pose_service.h"
#include "server/rpc/recording_service.h"
#include "server/rpc/registration_service.h"
#include "server/rpc/render_service.h"
#include "server/rpc/series_service.h"
#include "server/rpc/volume_service.h"
#include "server/session/path_policy.h"
#include "server/streaming/volume_streams.h"

namespace palpate {

struct ServerOptions {
  std::string socket_path;
  std::optional<HostPort> listen;  // loopback only: there is no TLS yet
  PathPolicy paths;                // that clients may name
  UploadOptions uploads;
};

// What the services work on: all but the list is borrowed.
struct ServedParts {
  Session& session;
  VolumeEditor& editor;
  SeriesPlayer& series;
  RecordingControl& recording;
  Pump& pump;
  HapticDevice& device;
  ServoLoop& servo;
  const SceneInbox& inbox;
  const ForceWatch& forces;
  DeviceList list_devices;  // what the machine has
};

class RpcServer {
 public:
  // Before the session's first load.
  RpcServer(ServerOptions options, const ServedParts& parts);
  ~RpcServer() { Stop(); }

  // Claims the socket's path and tries the port, so that a second daemon finds out
  // before it loads a volume. kConflict when another has them, kInvalidArgument
  // for an address that is not loopback.
  void Reserve();
  // After Reserve, with a volume in the session. kConflict when it cannot listen.
  void Start();
  // Ends streams and calls; the socket is removed.
  void Stop() noexcept;

 private:
  ServerOptions options_;
  PoseService poses_;
  RenderService render_;
  VolumeStreams volume_streams_;
  RegistrationService registration_;
  VolumeService volume_;
  SeriesService series_;
  DeviceService device_;
  RecordingService recording_;
  std::unique_ptr<grpc::Server> server_;
  int lock_fd_ = -1;
};

}  // namespace palpate
