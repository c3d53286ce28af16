#include "client/cli/connection.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>

#include "common/wire/address.h"
#include "common/wire/status.h"

namespace palpate::cli {
namespace {

constexpr std::chrono::seconds kConnectTimeout(3);
constexpr std::chrono::seconds kCallTimeout(5);

// gRPC reports every failure to connect alike; the file tells them apart.
void CheckSocket(const std::string& path, const std::string& name, const std::string& advice) {
  struct stat info {};
  const bool found = stat(path.c_str(), &info) == 0;
  if (!found && errno != EACCES) {
    throw Error(ErrorKind::kUnavailable, "no palpated at " + name + ": " + advice);
  }
  if (!found || access(path.c_str(), W_OK) != 0) {
    throw Error(ErrorKind::kPermissionDenied,
                "no permission to use " + name +
                    ": ask for membership of the group that owns the socket, or name another one "
                    "with --socket");
  }
  if (!S_ISSOCK(info.st_mode)) {
    throw Error(ErrorKind::kUnavailable,
                name + " is not a socket: name palpated's socket with --socket");
  }
}

}  // namespace

Connection::Connection(const ServerAddress& address) {
  std::string target;
  if (address.host_port.empty()) {
    const std::string path =
        address.socket_path.empty() ? DefaultSocketPath() : address.socket_path;
    target = UnixTarget(path);
    name_ = target;
    shares_clock_ = true;
    advice_ = "start it with 'palpated' or name its socket with --socket";
    CheckSocket(path, name_, advice_);
  } else {
    const HostPort host_port = ParseHostPort(address.host_port);
    target = TcpTarget(host_port);
    name_ = host_port.ToString();
    advice_ = "start it there or name its address with --server";
  }
  grpc::ChannelArguments arguments;
  // A proxy for web pages has no business between a stylus and its viewer.
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  channel_ = grpc::CreateCustomChannel(target, grpc::InsecureChannelCredentials(), arguments);
  WaitUntilReady();
}

void Connection::WaitUntilReady() const {
  const auto deadline = std::chrono::system_clock::now() + kConnectTimeout;
  grpc_connectivity_state state = channel_->GetState(true);
  while (state != GRPC_CHANNEL_READY) {
    if (state == GRPC_CHANNEL_TRANSIENT_FAILURE || state == GRPC_CHANNEL_SHUTDOWN) {
      throw Error(ErrorKind::kUnavailable, "no palpated at " + name_ + ": " + advice_);
    }
    if (!channel_->WaitForStateChange(state, deadline)) {
      throw Error(ErrorKind::kUnavailable,
                  "no answer from " + name_ + " within 3 s, so it is not palpated: " + advice_);
    }
    state = channel_->GetState(true);
  }
}

void Connection::SetDeadline(grpc::ClientContext& context) {
  context.set_deadline(std::chrono::system_clock::now() + kCallTimeout);
}

Error Connection::ErrorOf(const grpc::Status& status) const {
  switch (status.error_code()) {
    case grpc::StatusCode::DEADLINE_EXCEEDED:
      return {ErrorKind::kUnavailable, "palpated at " + name_ + " did not answer within 5 s"};
    case grpc::StatusCode::UNIMPLEMENTED:
      return {ErrorKind::kUnavailable,
              name_ +
                  " is not palpated, or one of another version: compare 'palpated --version' "
                  "and 'palpate --version'"};
    case grpc::StatusCode::UNAVAILABLE:
      return {ErrorKind::kUnavailable,
              "palpated at " + name_ + " is unavailable: " + status.error_message()};
    default:
      return FromStatus(status);
  }
}

}  // namespace palpate::cli
