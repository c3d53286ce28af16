#include "server/door/entrance.h"

#include <grp.h>
#include <grpcpp/impl/server_builder_option.h>
#include <grpcpp/impl/server_builder_plugin.h>
#include <pthread.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "common/wire/limits.h"

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
// The limit for all memory that gRPC counts, for all clients of one entrance. Above it, gRPC ends
// calls and connections of any client. With 128 MiB, two known clients with endless headers ended
// streams of others within 15 s, and the process grew as much as with 512 MiB.
constexpr std::size_t kMostBytes = std::size_t{512} << 20;

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

// Tells the services by which entrance a call came.
class Context final : public grpc::CallbackServerContext {
 public:
  explicit Context(Entrance& entrance) : entrance_(entrance) {}
  Entrance& entrance() const { return entrance_; }

 private:
  Entrance& entrance_;
};

// Counts the calls for the watch.
class Contexts final : public grpc::ContextAllocator {
 public:
  Contexts(Entrance& entrance, DeafWatch* watch) : entrance_(entrance), watch_(watch) {}
  grpc::CallbackServerContext* NewCallbackServerContext() override {
    return Began(new Context(entrance_));
  }
  void Release(grpc::CallbackServerContext* context) override { End(context); }
  // For methods that do not exist. gRPC 1.51 ends the process without these two.
  grpc::GenericCallbackServerContext* NewGenericCallbackServerContext() override {
    return Began(new grpc::GenericCallbackServerContext);
  }
  void Release(grpc::GenericCallbackServerContext* context) override { End(context); }

 private:
  template <class Any>
  Any* Began(Any* context) {
    if (watch_) watch_->Began();
    return context;
  }
  template <class Any>
  void End(Any* context) {
    if (watch_) watch_->Ended();
    delete context;
  }

  Entrance& entrance_;
  DeafWatch* const watch_;  // null: none
};

// Removes reflection, which its library adds to every server.
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

// gRPC lets two servers listen on one path without noticing each other, so a lock file decides. The
// file stays when the daemon ends: if it were removed, one daemon could lock the old file and
// another a new one.
void ClaimSocket(const std::string& path, FileLock& lock) {
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

void RemoveLeftSocket(const std::string& path) {
  struct stat status {};
  FileLock lock;
  if (lstat(path.c_str(), &status) == 0 && S_ISSOCK(status.st_mode) &&
      lock.Take(path + ".lock", LockOf::kFile) == LockResult::kTaken) {
    unlink(path.c_str());
  }
}

gid_t GroupOf(const std::string& name) {
  group found{};
  group* result = nullptr;
  std::vector<char> text(1 << 20);
  const int error = getgrnam_r(name.c_str(), &found, text.data(), text.size(), &result);
  if (error != 0) Refuse("cannot look up the group " + name + ": " + std::strerror(error));
  if (!result) Refuse("there is no group " + name + ": make it (groupadd --system " + name + ")");
  return result->gr_gid;
}

Entrance& Entrance::Of(const grpc::ServerContextBase& context) {
  return dynamic_cast<const Context&>(context).entrance();
}

std::unique_ptr<grpc::ContextAllocator> Entrance::MakeContexts() {
  return std::make_unique<Contexts>(*this, deaf_watch_.get());
}

void Entrance::ReserveSocket(const std::string& path, const std::string& group) {
  UnixTarget(path);
  if (!group.empty()) group_ = GroupOf(group);
  ClaimSocket(path, lock_);
  path_ = path;
  if (!entry_.IsPreferred()) deaf_watch_ = std::make_unique<DeafWatch>(path, first_second_file_);
}

void Entrance::ReservePort(const HostPort& address, std::optional<Role> loopback_role) {
  acceptor_.TakePort(address, loopback_role);
}

void Entrance::Start(std::span<grpc::Service* const> services,
                     const std::shared_ptr<grpc::ServerCredentials>& credentials,
                     bool with_reflection) {
  using Type = grpc::ServerBuilder::experimental_type::ExternalConnectionType;
  grpc::ServerBuilder builder;
  if (!with_reflection) builder.SetOption(std::make_unique<WithoutPlugins>());
  Bound(builder);
  builder.SetContextAllocator(MakeContexts());
  Acceptor::Sink sink =
      builder.experimental().AddExternalConnectionAcceptor(Type::FROM_FD, credentials);
  for (grpc::Service* const service : services) builder.RegisterService(service);
  builder.RegisterCallbackGenericService(&others_);
  if (!path_.empty()) {
    const bool is_owners = entry_.transport == Transport::kDoor && !group_;
    acceptor_.TakeSocket(path_, is_owners ? 0600 : 0660, group_, deaf_watch_.get());
  }
  standby_queue_ = builder.AddCompletionQueue();
  server_ = builder.BuildAndStart();
  if (!server_) throw Error(ErrorKind::kInternal, "gRPC does not start: see its lines above");
  standby_ = std::thread([this] {
    pthread_setname_np(pthread_self(), "palpate-rpc");
    Drain(*standby_queue_);
  });
  acceptor_.Start(std::move(sink));
}

void Entrance::Stop(std::chrono::system_clock::time_point deadline) noexcept {
  acceptor_.Stop();
  if (server_) {
    server_->Shutdown(deadline);
    server_->Wait();
    server_.reset();
    if (!path_.empty()) unlink(path_.c_str());
  }
  if (standby_queue_) standby_queue_->Shutdown();
  if (standby_.joinable()) {
    standby_.join();
  } else if (standby_queue_) {
    Drain(*standby_queue_);
  }
  standby_queue_.reset();
}

}  // namespace palpate
