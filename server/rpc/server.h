// The gRPC server: services, health, reflection, and where it listens.
//
// Threads: construct, Start and Stop on the main thread.
// Errors: Error with what is wrong and what to do.
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <optional>
#include <string>

#include "common/files/file_lock.h"
#include "common/wire/address.h"
#include "server/metrics/service_metrics.h"
#include "server/rpc/acceptor.h"
#include "server/rpc/access.h"
#include "server/rpc/device_service.h"
#include "server/rpc/pose_service.h"
#include "server/rpc/recording_service.h"
#include "server/rpc/registration_service.h"
#include "server/rpc/render_service.h"
#include "server/rpc/security_files.h"
#include "server/rpc/series_service.h"
#include "server/rpc/standby_poller.h"
#include "server/rpc/tls.h"
#include "server/rpc/volume_service.h"
#include "server/session/path_policy.h"
#include "server/streaming/volume_streams.h"

namespace palpate {

struct SecurityOptions {
  PolicyOptions policy{};
  TlsOptions tls{};  // of `listen`; no certificate: plain
  LimitOptions limits{};
  int connections = 1024;  // at most, of all clients
};

// Throws kInvalidArgument for an address that may not be listened on with this security:
// beyond loopback only with TLS, and TLS only with a way to know clients; and for a name.
void CheckListen(const HostPort& listen, const SecurityOptions& security);

struct ServerOptions {
  std::string socket_path;
  std::optional<HostPort> listen;  // other than loopback only with TLS
  PathPolicy paths;                // that clients may name
  UploadOptions uploads;
  SecurityOptions security{};
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
  ServiceMetrics& metrics;
};

class RpcServer {
 public:
  // Before the session's first load.
  RpcServer(ServerOptions options, const ServedParts& parts);
  ~RpcServer() { Stop(); }

  // Claims the socket's path, so that a second daemon finds out before it loads a
  // volume. kConflict when another has it, kInvalidArgument for an address that is not
  // loopback without TLS, and for files of security that are not fit.
  void Reserve();
  // After Reserve: the same of the port, where there is one to be.
  void ReservePort();
  // After Reserve, with a volume in the session. kConflict when it cannot listen.
  void Start();
  // As SecurityFiles::Prepare; what it returns is called before Stop.
  std::function<void()> PrepareSecurity(const PolicyOptions& policy);
  // Ends streams and calls; the socket is removed.
  void Stop() noexcept;

  // Subscribers of the volume; any thread.
  std::size_t volume_streams() const { return volume_streams_.streams(); }

 private:
  ServerOptions options_;
  ConnectionWatch watch_;
  Access access_;
  Acceptor acceptor_;
  std::unique_ptr<TlsFiles> tls_;
  PoseService poses_;
  RenderService render_;
  VolumeStreams volume_streams_;
  RegistrationService registration_;
  VolumeService volume_;
  SeriesService series_;
  DeviceService device_;
  RecordingService recording_;
  std::unique_ptr<StandbyPoller> poller_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<SecurityFiles> security_files_;
  FileLock lock_;
};

}  // namespace palpate
