#include "server/rpc/server.h"

#include <fcntl.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/health_check_service_interface.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>

#include "common/error/error.h"

namespace palpate {
namespace {

constexpr int kMaxMessageBytes = 4 << 20;
constexpr std::chrono::seconds kShutdownPatience{1};

bool IsLoopback(const HostPort& address) {
  return address.host == "localhost" || address.host == "::1" || address.host.starts_with("127.");
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

}  // namespace

RpcServer::RpcServer(ServerOptions options, Session& session, Pump& pump, const DeviceSpec& device,
                     const ServoLoop& servo, const SceneInbox& inbox)
    : options_(std::move(options)),
      poses_(pump),
      render_(session),
      volume_(session),
      device_(device, servo, inbox) {}

// gRPC lets two servers listen on one path, each believing itself alone: a lock
// file decides.
void RpcServer::Reserve() {
  if (options_.listen && !IsLoopback(*options_.listen)) {
    throw Error(ErrorKind::kInvalidArgument,
                "will not listen on " + options_.listen->ToString() +
                    ": without TLS only loopback addresses are allowed (127.0.0.1, ::1)");
  }
  MakeSocketFolder(std::filesystem::path(options_.socket_path).parent_path());
  const std::string lock_path = options_.socket_path + ".lock";
  lock_fd_ = open(lock_path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  if (lock_fd_ < 0) {
    throw Error(ErrorKind::kPermissionDenied, "cannot write " + lock_path + ": " +
                                                  std::strerror(errno) +
                                                  "; name another socket with --socket");
  }
  if (flock(lock_fd_, LOCK_EX | LOCK_NB) != 0) {
    close(lock_fd_);
    lock_fd_ = -1;
    throw Error(ErrorKind::kConflict, "another palpated listens on " + options_.socket_path +
                                          ": stop it, or name another socket with --socket");
  }
  // Left behind by a daemon that was killed.
  unlink(options_.socket_path.c_str());
}

void RpcServer::Start() {
  const std::string target = UnixTarget(options_.socket_path);
  grpc::EnableDefaultHealthCheckService(true);
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  grpc::ServerBuilder builder;
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  builder.SetMaxReceiveMessageSize(kMaxMessageBytes);
  builder.AddListeningPort(target, grpc::InsecureServerCredentials());
  int port = 0;
  if (options_.listen) {
    builder.AddListeningPort(options_.listen->ToString(), grpc::InsecureServerCredentials(), &port);
  }
  builder.RegisterService(&poses_);
  builder.RegisterService(&render_);
  builder.RegisterService(&volume_);
  builder.RegisterService(&device_);
  server_ = builder.BuildAndStart();
  if (!server_ || (options_.listen && port == 0)) {
    const bool tcp = options_.listen && port == 0;
    throw Error(ErrorKind::kConflict,
                "cannot listen on " + (tcp ? options_.listen->ToString() : options_.socket_path) +
                    (tcp ? ": the port is in use or not ours; name another with --listen"
                         : ": check the folder's permissions, or name another with --socket"));
  }
  chmod(options_.socket_path.c_str(), 0660);
}

void RpcServer::Stop() noexcept {
  if (server_) {
    server_->Shutdown(std::chrono::system_clock::now() + kShutdownPatience);
    server_->Wait();
    server_.reset();
  }
  if (lock_fd_ >= 0) {
    unlink(options_.socket_path.c_str());
    unlink((options_.socket_path + ".lock").c_str());
    close(lock_fd_);
    lock_fd_ = -1;
  }
}

}  // namespace palpate
