#include "server/services/server.h"

#include <absl/synchronization/mutex.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/health_check_service_interface.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <filesystem>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "server/door/open_files.h"
#include "server/log/log.h"
#include "server/realtime/thread_setup.h"

namespace palpate {
namespace {

constexpr std::chrono::seconds kShutdownPatience{1};

// While this object lives, the calling thread starts threads that go before ordinary ones: those
// that bring the emergency stop. Beside two busy loops, 900 connections that end at once delay it
// by at most 290 ms, and by up to 590 ms without this.
class StartsUrgentThreads {
 public:
  StartsUrgentThreads() { SetThreadNice(std::min(before_, kNice)); }
  ~StartsUrgentThreads() { SetThreadNice(before_); }
  StartsUrgentThreads(const StartsUrgentThreads&) = delete;
  StartsUrgentThreads& operator=(const StartsUrgentThreads&) = delete;

 private:
  static constexpr int kNice = -5;  // as LimitNICE= of the unit
  const int before_ = ThreadNice();
};

void MakeSocketFolder(const std::filesystem::path& folder) {
  if (folder.empty() || std::filesystem::exists(folder)) return;
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (!error) std::filesystem::permissions(folder, std::filesystem::perms::owner_all, error);
  if (error) {
    throw Error(ErrorKind::kPermissionDenied, "cannot make the socket's folder " + folder.string() +
                                                  ": " + error.message() +
                                                  "; name another with --socket");
  }
}

// Warns if not. The usual socket and its stop's are checked before.
bool IsShortEnough(const std::string& path) {
  const bool is = std::filesystem::absolute(path).string().size() <= kMaxSocketPathLength;
  if (!is) {
    LogWarning(
        "there is no socket {}: its path would have more than {} bytes; name a shorter one with "
        "--socket",
        path, kMaxSocketPathLength);
  }
  return is;
}

}  // namespace

RpcServer::RpcServer(ServerOptions options, const ServedParts& parts)
    : options_(std::move(options)),
      first_refused_file_(FirstRefusedFile(RaiseOpenFileLimit(), options_.security.connections)),
      first_second_file_(FirstSecondFile(RaiseOpenFileLimit(), options_.security.connections)),
      watch_(first_second_file_),
      access_(options_.security.limits, &watch_),
      calls_(access_, parts.session),
      poses_(access_, parts.pump, parts.metrics),
      render_(calls_, parts.session, parts.metrics),
      volume_streams_(parts.session),
      registration_(calls_, parts.session),
      volume_(calls_, parts.session, parts.editor, options_.paths, options_.uploads,
              volume_streams_, parts.metrics),
      series_(calls_, parts.session, parts.series, options_.paths),
      device_(calls_, parts.device, parts.hand, parts.servo, parts.stop_door, parts.inbox,
              parts.session, parts.forces, parts.list_devices),
      recording_(calls_, parts.recording, parts.editor),
      activity_(calls_),
      facts_(access_, parts.session, parts.series, parts.recording, device_),
      stop_door_(parts.stop_door) {
  access_.SetOnReview([this] { device_.EndRevokedPush(); });
  parts.session.shown().SetOnReplace([this](const ShownScene* replayed) {
    volume_streams_.Show(replayed);
    facts_.SceneMayHaveChanged();
  });
}

void RpcServer::AddSocket(const Entry& entry, const std::string& path, const std::string& group) {
  if (IsShortEnough(path)) AddEntrance(entry).ReserveSocket(path, group);
}

void RpcServer::AddStopSocket(const StopSocket& socket) {
  if (!IsShortEnough(socket.path)) return;
  ClaimSocket(socket.path, stop_locks_.emplace_back());
  stop_sockets_.push_back(socket);
}

Entrance& RpcServer::AddEntrance(const Entry& entry) {
  return *entrances_.emplace_back(
      std::make_unique<Entrance>(entry, first_refused_file_, first_second_file_, watch_));
}

void RpcServer::Reserve() {
  const std::string& usual = options_.socket_path;
  UnixTarget(usual);
  UnixTarget(StopSocketPath(usual));
  if (options_.listen) {
    if (options_.listen->host == "localhost") options_.listen->host = "127.0.0.1";
    CheckListen(*options_.listen, options_.security);
  }
  MakeSocketFolder(std::filesystem::path(usual).parent_path());
  const SocketGroups& groups = options_.groups;
  for (const auto& [role, group] :
       {std::pair(Role::kAdmin, std::string()), std::pair(Role::kOperator, groups.operators),
        std::pair(Role::kEditor, groups.editors), std::pair(Role::kViewer, groups.viewers)}) {
    const std::string path = RoleSocketPath(usual, role);
    AddSocket({Transport::kSocket, role, !group.empty()}, path, group);
    AddSocket({Transport::kDoor, role, true}, DoorSocketPath(usual, role), groups.door);
    const std::string stop = StopSocketPath(path);
    RemoveLeftSocket(stop);
    if (!group.empty()) AddStopSocket({.path = stop, .group = GroupOf(group)});
  }
  AddStopSocket({.path = StopSocketPath(usual)});
  AddStopSocket({.path = DoorStopPath(usual),
                 .group = groups.door.empty() ? std::nullopt : std::optional(GroupOf(groups.door)),
                 .is_door = true});
  if (!options_.security.tls.certificate.empty()) {
    const StartsUrgentThreads urgent;
    tls_ = std::make_unique<TlsFiles>(options_.security.tls, usual + ".tls");
  }
  security_files_ = std::make_unique<SecurityFiles>(access_, tls_.get());
  security_files_->Start(options_.security.policy, options_.security.tls);
}

void RpcServer::ReservePort() {
  if (!options_.listen) return;
  const std::optional<Role> loopback_role =
      tls_ ? std::nullopt : std::optional(options_.security.policy.loopback_role);
  AddEntrance({tls_ ? Transport::kTls : Transport::kPlain})
      .ReservePort(*options_.listen, loopback_role);
}

// A client on an address other than loopback must prove its identity, and must be able to verify
// ours.
void CheckListen(const HostPort& listen, const SecurityOptions& security) {
  const bool knows_clients =
      !security.policy.tokens.empty() ||
      (!security.policy.client_ca.empty() && !security.policy.clients.empty());
  const bool has_tls = !security.tls.certificate.empty();
  const bool is_loopback = listen.host == "localhost" || IsLoopback(listen);
  const bool is_safe = has_tls ? knows_clients : is_loopback;
  if (!is_safe) {
    throw Error(ErrorKind::kInvalidArgument,
                "will not listen on " + listen.ToString() + ": " +
                    (has_tls ? "TLS needs a way to know clients: set tls.tokens, or tls.client_ca "
                               "with a [[tls.client]]"
                             : "without TLS only loopback addresses are allowed (127.0.0.1, ::1); "
                               "set tls.certificate, tls.key, and tls.tokens or tls.client_ca"));
  }
  if (listen.host != "localhost") CheckAddress(listen);
}

void RpcServer::Start() {
  // Debian's Abseil looks for deadlocks of gRPC's mutexes, all threads under one lock, and ends the
  // process where it believes to see one.
  absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
  const StartsUrgentThreads urgent;
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  stop_door_.Open(stop_sockets_);
  watch_.Start();
  grpc::Service* const services[] = {&poses_,  &render_,    &registration_, &volume_, &series_,
                                     &device_, &recording_, &activity_,     &facts_};
  for (const auto& entrance : entrances_) {
    const bool is_tls = entrance->entry().transport == Transport::kTls;
    // gRPC's own services ask nobody who calls, and Access does not bound them.
    const bool with_grpcs = !tls_ && (entrance->entry().IsPreferred() ||
                                      entrance->entry().transport == Transport::kPlain);
    grpc::EnableDefaultHealthCheckService(with_grpcs);
    entrance->Start(services, is_tls ? tls_->MakeCredentials() : grpc::InsecureServerCredentials(),
                    /*with_reflection=*/with_grpcs);
  }
}

std::function<void()> RpcServer::PrepareSecurity(const PolicyOptions& policy) {
  return security_files_->Prepare(policy);
}

void RpcServer::Stop() noexcept {
  if (security_files_) security_files_->Stop();
  for (const auto& entrance : entrances_) entrance->StopAccepting();
  volume_streams_.Stop();
  facts_.Stop();
  const auto deadline = std::chrono::system_clock::now() + kShutdownPatience;
  std::vector<std::thread> stops;  // all clients have the same time
  for (const auto& entrance : entrances_) {
    try {
      stops.emplace_back([&entrance, deadline] { entrance->Stop(deadline); });
    } catch (const std::exception&) {
      entrance->Stop(deadline);  // the system allows no more threads
    }
  }
  for (std::thread& stop : stops) stop.join();
  // The stop works until here.
  stop_door_.Close();
  // Destroyed while the locks are held: afterwards another daemon may make the folder anew.
  security_files_.reset();
  tls_.reset();
  stop_locks_.clear();
  entrances_.clear();
}

}  // namespace palpate
