// What others reach by gRPC: the services, at one entrance for each role's socket and the port.
//
// Threads: construct, Start and Stop on the main thread.
// Errors: Error that says what is wrong and what to do.
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/files/file_lock.h"
#include "common/wire/address.h"
#include "server/client_paths/path_policy.h"
#include "server/door/access.h"
#include "server/door/entrance.h"
#include "server/door/security_files.h"
#include "server/metrics/service_metrics.h"
#include "server/services/calls.h"
#include "server/services/device_service.h"
#include "server/services/facts_service.h"
#include "server/services/pose_service.h"
#include "server/services/recording_service.h"
#include "server/services/render_service.h"
#include "server/services/volume_service.h"
#include "server/volume_stream/volume_streams.h"

namespace palpate {

struct SecurityOptions {
  PolicyOptions policy{};
  TlsOptions tls{};  // for `listen`; without a certificate, `listen` is not encrypted
  LimitOptions limits{};
  int connections = 1024;  // at most, for all clients together
};

// Throws kInvalidArgument if the server must not listen on the address with this security.
// Addresses other than loopback need TLS, TLS needs a way to know clients, and a host name is not
// allowed.
void CheckListen(const HostPort& listen, const SecurityOptions& security);

// The groups that own sockets, by name. Empty: that of the process, so that those who may open the
// usual socket may open it.
struct SocketGroups {
  std::string operators{}, editors{}, viewers{};  // of the sockets of these roles
  std::string door{};                             // empty: there are no sockets for a door
};

struct ServerOptions {
  std::string socket_path;  // the usual one, for admins; the others are beside it
  SocketGroups groups{};
  std::optional<HostPort> listen;  // addresses other than loopback need TLS
  PathPolicy paths;                // paths that clients may name
  UploadOptions uploads;
  SecurityOptions security{};
};

// The parts that the services use. All are borrowed except the list.
struct ServedParts {
  Session& session;
  VolumeEditor& editor;
  SeriesPlayer& series;
  RecordingControl& recording;
  Pump& pump;
  HapticDevice& device;
  LedHand* hand;  // null: the device is not the simulated one
  ServoLoop& servo;
  StopDoor& stop_door;
  const SceneInbox& inbox;
  const ForceWatch& forces;
  DeviceList list_devices;  // lists the machine's devices
  ServiceMetrics& metrics;
};

class RpcServer {
 public:
  // Construct it before the session's first load.
  RpcServer(ServerOptions options, const ServedParts& parts);
  ~RpcServer() { Stop(); }

  // Claims the sockets' paths, so that a second daemon fails before it loads a volume. Throws
  // kConflict if another daemon has the path; kInvalidArgument for an address that is not loopback
  // without TLS, and for unusable security files.
  void Reserve();
  // Call it after Reserve. Claims the port, if one is configured.
  void ReservePort();
  // Call it after Reserve, with a running servo. Calls that need a volume are answered with
  // kLoading until the session has one. Throws kConflict if it cannot listen.
  void Start();
  // See SecurityFiles::Prepare. Call the returned function before Stop.
  std::function<void()> PrepareSecurity(const PolicyOptions& policy);
  // Ends streams and calls, and removes the sockets.
  void Stop() noexcept;

  // Number of subscribers of the volume; any thread.
  std::size_t volume_streams() const { return volume_streams_.streams(); }

 private:
  void AddSocket(const Entry& entry, const std::string& path, const std::string& group);
  void AddStopSocket(const StopSocket& socket);
  Entrance& AddEntrance(const Entry& entry);

  ServerOptions options_;
  const int first_refused_file_;
  const int first_second_file_;
  ConnectionWatch watch_;
  Access access_;
  Calls calls_;
  std::unique_ptr<TlsFiles> tls_;
  PoseService poses_;
  RenderService render_;
  VolumeStreams volume_streams_;
  RegistrationService registration_;
  VolumeService volume_;
  SeriesService series_;
  DeviceService device_;
  RecordingService recording_;
  ActivityService activity_;
  FactsService facts_;
  StopDoor& stop_door_;
  std::vector<std::unique_ptr<Entrance>> entrances_;
  std::unique_ptr<SecurityFiles> security_files_;
  std::vector<StopSocket> stop_sockets_;
  std::vector<FileLock> stop_locks_;  // of these
};

}  // namespace palpate
