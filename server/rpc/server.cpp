#include "server/rpc/server.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/health_check_service_interface.h>
#include <netinet/in.h>
#include <sys/file.h>
#include <sys/socket.h>
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

// Only literal addresses: a name may resolve to anything.
bool IsLoopback(const HostPort& address) {
  in_addr v4{};
  in6_addr v6{};
  if (inet_pton(AF_INET, address.host.c_str(), &v4) == 1) return ntohl(v4.s_addr) >> 24 == 127;
  return inet_pton(AF_INET6, address.host.c_str(), &v6) == 1 && IN6_IS_ADDR_LOOPBACK(&v6);
}

// Finds out before a volume is loaded what gRPC would only say at the end.
void CheckPortIsFree(const HostPort& address) {
  const bool is_v6 = address.host.find(':') != std::string::npos;
  sockaddr_in v4{};
  sockaddr_in6 v6{};
  v4.sin_family = AF_INET;
  v4.sin_port = v6.sin6_port = htons(address.port);
  v6.sin6_family = AF_INET6;
  if (is_v6) {
    inet_pton(AF_INET6, address.host.c_str(), &v6.sin6_addr);
  } else {
    inet_pton(AF_INET, address.host.c_str(), &v4.sin_addr);
  }
  const int fd = socket(is_v6 ? AF_INET6 : AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int on = 1;
  setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  const int bound = is_v6 ? bind(fd, reinterpret_cast<const sockaddr*>(&v6), sizeof(v6))
                          : bind(fd, reinterpret_cast<const sockaddr*>(&v4), sizeof(v4));
  const int error = errno;
  if (fd >= 0) close(fd);
  if (fd < 0 || bound != 0) {
    throw Error(ErrorKind::kConflict, "cannot listen on " + address.ToString() + ": " +
                                          std::strerror(error) +
                                          "; name another address with --listen");
  }
}

// A socket that a killed daemon left behind; nothing else is removed.
void RemoveStaleSocket(const std::string& path) {
  struct stat status {};
  if (lstat(path.c_str(), &status) != 0) return;
  if (!S_ISSOCK(status.st_mode)) {
    throw Error(ErrorKind::kInvalidArgument,
                path + " is there and is no socket: name another path with --socket");
  }
  unlink(path.c_str());
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

RpcServer::RpcServer(ServerOptions options, const ServedParts& parts)
    : options_(std::move(options)),
      poses_(parts.pump),
      render_(parts.session),
      volume_streams_(parts.session),
      registration_(parts.session),
      volume_(parts.session, parts.editor, options_.paths, options_.uploads, volume_streams_),
      series_(parts.session, parts.series, options_.paths),
      device_(parts.device, parts.servo, parts.inbox, parts.forces, parts.list_devices),
      recording_(parts.recording) {}

// gRPC lets two servers listen on one path, each believing itself alone: a lock
// file decides. It stays when the daemon ends; removing it would let one daemon
// lock the old file and another a new one.
void RpcServer::Reserve() {
  UnixTarget(options_.socket_path);
  if (options_.listen) {
    if (options_.listen->host == "localhost") options_.listen->host = "127.0.0.1";
    if (!IsLoopback(*options_.listen)) {
      throw Error(ErrorKind::kInvalidArgument,
                  "will not listen on " + options_.listen->ToString() +
                      ": without TLS only loopback addresses are allowed (127.0.0.1, ::1)");
    }
  }
  MakeSocketFolder(std::filesystem::path(options_.socket_path).parent_path());
  const std::string lock_path = options_.socket_path + ".lock";
  lock_fd_ = open(lock_path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
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
  RemoveStaleSocket(options_.socket_path);
  if (options_.listen) CheckPortIsFree(*options_.listen);
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
  builder.RegisterService(&registration_);
  builder.RegisterService(&volume_);
  builder.RegisterService(&series_);
  builder.RegisterService(&device_);
  builder.RegisterService(&recording_);
  server_ = builder.BuildAndStart();
  if (!server_ || (options_.listen && port == 0)) {
    const bool tcp = options_.listen && port == 0;
    throw Error(ErrorKind::kConflict,
                "cannot listen on " + (tcp ? options_.listen->ToString() : options_.socket_path) +
                    (tcp ? ": the port is in use; name another with --listen"
                         : ": check the folder's permissions, or name another with --socket"));
  }
  chmod(options_.socket_path.c_str(), 0660);
}

void RpcServer::Stop() noexcept {
  volume_streams_.Stop();
  if (server_) {
    server_->Shutdown(std::chrono::system_clock::now() + kShutdownPatience);
    server_->Wait();
    server_.reset();
    unlink(options_.socket_path.c_str());
  }
  if (lock_fd_ >= 0) close(lock_fd_);
  lock_fd_ = -1;
}

}  // namespace palpate
