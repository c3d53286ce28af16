#include "server/services/server.h"

#include <absl/synchronization/mutex.h>
#include <arpa/inet.h>
#include <fcntl.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/impl/server_builder_option.h>
#include <grpcpp/impl/server_builder_plugin.h>
#include <netinet/in.h>
#include <pthread.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <vector>

#include "common/error/error.h"
#include "common/wire/limits.h"
#include "server/door/open_files.h"
#include "server/realtime/thread_setup.h"

namespace palpate {
namespace {

// The largest message of a client is an edit with a block of values.
constexpr int kMaxMessageBytes = static_cast<int>(kMostBlockBytes) + (64 << 10);
// HTTP/2 recommends at least 100. Above the limit, gRPC's clients delay further calls without an
// error. That includes the emergency stop if it shares the connection.
constexpr int kMostCallsPerConnection = 100;
constexpr int kHandshakeTimeoutMs = 10'000;
constexpr int kKeepaliveMs = 20'000;
constexpr int kKeepaliveTimeoutMs = 10'000;
constexpr int kLeastProbeMs = 500;
constexpr int kIdleMs = 600'000;
constexpr int kMostThreads = 16;  // for reflection; our services use none of these
// The limit for all memory that gRPC counts, for all clients together. Above it, gRPC ends calls
// and connections of any client. With 128 MiB, two known clients with endless headers ended streams
// of others and connections on the socket within 15 s, and the process grew as much as with 512
// MiB.
constexpr std::size_t kMostBytes = std::size_t{512} << 20;
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

// Removes a socket that a killed daemon left behind. Removes nothing else.
void RemoveStaleSocket(const std::string& path) {
  struct stat status {};
  if (lstat(path.c_str(), &status) != 0) return;
  if (!S_ISSOCK(status.st_mode)) {
    throw Error(ErrorKind::kInvalidArgument,
                path + " exists and is no socket: name another path with --socket");
  }
  unlink(path.c_str());
}

// While the lock is held, the socket is ours.
void Claim(const std::string& path, FileLock& lock) {
  const std::string lock_path = path + ".lock";
  switch (lock.Take(lock_path, LockOf::kFile)) {
    case LockResult::kTaken:
      return RemoveStaleSocket(path);
    case LockResult::kHeldByAnother:
      throw Error(ErrorKind::kConflict, "another palpated listens on " + path +
                                            ": stop it, or name another socket with --socket");
    case LockResult::kCannotOpen:
      throw Error(ErrorKind::kPermissionDenied, "cannot write " + lock_path + ": " +
                                                    std::strerror(errno) +
                                                    "; name another socket with --socket");
  }
}

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

// Removes reflection, which its library adds to every server. Used with TLS: reflection, like
// health, is gRPC's own service and does not check the caller.
class WithoutPlugins final : public grpc::ServerBuilderOption {
 public:
  void UpdateArguments(grpc::ChannelArguments*) override {}
  void UpdatePlugins(std::vector<std::unique_ptr<grpc::ServerBuilderPlugin>>* plugins) override {
    plugins->clear();
  }
};

// Waits on the queue until its shutdown; the queue gets no events.
void Drain(grpc::ServerCompletionQueue& queue) {
  void* tag = nullptr;
  for (bool ok = false; queue.Next(&tag, &ok);) {
  }
}

// Limits how much of gRPC itself a client may use, before and besides any call.
void Bound(grpc::ServerBuilder& builder) {
  builder.SetMaxReceiveMessageSize(kMaxMessageBytes);
  // A compressed message grows when it is read, and would exceed the size that was checked.
  builder.SetCompressionAlgorithmSupportStatus(GRPC_COMPRESS_DEFLATE, false);
  builder.SetCompressionAlgorithmSupportStatus(GRPC_COMPRESS_GZIP, false);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, kMostCallsPerConnection);
  // Limits the time from the connection to the client's first settings. Slower clients are cut off.
  builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, kHandshakeTimeoutMs);
  // Finds a peer that vanished without closing, and ends its streams.
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepaliveTimeoutMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  // Our clients probe each second. gRPC ends connections that probe more often.
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, kLeastProbeMs);
  // Closes connections without calls; clients reconnect automatically.
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_IDLE_MS, kIdleMs);
  grpc::ResourceQuota quota("palpated");
  quota.SetMaxThreads(kMostThreads);
  quota.Resize(kMostBytes);
  builder.SetResourceQuota(quota);
}

}  // namespace

RpcServer::RpcServer(ServerOptions options, const ServedParts& parts)
    : options_(std::move(options)),
      watch_(FirstSecondFile(RaiseOpenFileLimit(), options_.security.connections)),
      access_(options_.security.limits, &watch_),
      calls_(access_, parts.session),
      acceptor_(FirstRefusedFile(RaiseOpenFileLimit(), options_.security.connections), watch_),
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

// gRPC lets two servers listen on one path without noticing each other, so a lock file decides. The
// file stays when the daemon ends: if it were removed, one daemon could lock the old file and
// another a new one.
void RpcServer::Reserve() {
  UnixTarget(options_.socket_path);
  const std::string stop_path = StopSocketPath(options_.socket_path);
  UnixTarget(stop_path);
  if (options_.listen) {
    if (options_.listen->host == "localhost") options_.listen->host = "127.0.0.1";
    CheckListen(*options_.listen, options_.security);
  }
  MakeSocketFolder(std::filesystem::path(options_.socket_path).parent_path());
  Claim(options_.socket_path, lock_);
  Claim(stop_path, stop_lock_);
  if (!options_.security.tls.certificate.empty()) {
    const StartsUrgentThreads urgent;
    tls_ = std::make_unique<TlsFiles>(options_.security.tls, options_.socket_path + ".tls");
  }
  security_files_ = std::make_unique<SecurityFiles>(access_, tls_.get());
  security_files_->Start(options_.security.policy, options_.security.tls);
}

void RpcServer::ReservePort() {
  if (!options_.listen) return;
  const std::optional<Role> loopback_role =
      tls_ ? std::nullopt : std::optional(options_.security.policy.loopback_role);
  acceptor_.TakePort(*options_.listen, loopback_role);
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
  grpc::EnableDefaultHealthCheckService(!tls_);
  grpc::ServerBuilder builder;
  if (tls_) builder.SetOption(std::make_unique<WithoutPlugins>());
  Bound(builder);
  std::vector<Acceptor::Sink> sinks;
  const auto add_sink = [&](const std::shared_ptr<grpc::ServerCredentials>& credentials) {
    using Type = grpc::ServerBuilder::experimental_type::ExternalConnectionType;
    sinks.push_back(
        builder.experimental().AddExternalConnectionAcceptor(Type::FROM_FD, credentials));
  };
  if (options_.listen) {
    add_sink(tls_ ? tls_->MakeCredentials() : grpc::InsecureServerCredentials());
  }
  add_sink(grpc::InsecureServerCredentials());
  for (grpc::Service* service :
       std::initializer_list<grpc::Service*>{&poses_, &render_, &registration_, &volume_, &series_,
                                             &device_, &recording_, &activity_, &facts_}) {
    builder.RegisterService(service);
  }
  calls_.threads().Start();
  stop_door_.Open(StopSocketPath(options_.socket_path));
  acceptor_.TakeSocket(options_.socket_path);
  standby_queue_ = builder.AddCompletionQueue();
  server_ = builder.BuildAndStart();
  if (!server_) throw Error(ErrorKind::kInternal, "gRPC does not start: see its lines above");
  standby_ = std::thread([this] {
    pthread_setname_np(pthread_self(), "palpate-rpc");
    Drain(*standby_queue_);
  });
  acceptor_.Start(std::move(sinks));
}

std::function<void()> RpcServer::PrepareSecurity(const PolicyOptions& policy) {
  return security_files_->Prepare(policy);
}

void RpcServer::Stop() noexcept {
  if (security_files_) security_files_->Stop();
  acceptor_.Stop();
  volume_streams_.Stop();
  facts_.Stop();
  if (server_) {
    server_->Shutdown(std::chrono::system_clock::now() + kShutdownPatience);
    server_->Wait();
    server_.reset();
    unlink(options_.socket_path.c_str());
  }
  if (standby_queue_) standby_queue_->Shutdown();
  if (standby_.joinable()) {
    standby_.join();
  } else if (standby_queue_) {
    Drain(*standby_queue_);
  }
  standby_queue_.reset();
  // The stop works until here.
  stop_door_.Close();
  // Destroyed while the lock is held: afterwards another daemon may make the folder anew.
  security_files_.reset();
  tls_.reset();
  stop_lock_ = {};
  lock_ = {};
}

}  // namespace palpate
