#include "client/sdk/link.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include "client/sdk/backoff.h"
#include "common/wire/address.h"
#include "common/wire/status.h"

namespace palpate::client {
namespace {

std::shared_ptr<grpc::Channel> MakeChannel(const std::string& target) {
  grpc::ChannelArguments arguments;
  // A proxy for web pages has no business between a stylus and its viewer.
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  // A connection of its own, and not one that channels to the same target share.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  // Of the volume's, where only that one breaks: the pose thread knows of nothing then.
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, Backoff::kFirst.count());
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, Backoff::kLongest.count());
  return grpc::CreateCustomChannel(target, grpc::InsecureChannelCredentials(), arguments);
}

// gRPC reports every failure to connect alike; the file tells them apart.
Error WhyUnreached(const std::string& socket_path, const std::string& name) {
  if (socket_path.empty()) {
    return {ErrorKind::kUnavailable, "no palpated at " + name + ": start it there"};
  }
  struct stat info {};
  const bool found = stat(socket_path.c_str(), &info) == 0;
  if (found ? access(socket_path.c_str(), W_OK) != 0 : errno == EACCES) {
    return {
        ErrorKind::kPermissionDenied,
        "no permission to use " + name + ": ask for membership of the group that owns the socket"};
  }
  if (found && !S_ISSOCK(info.st_mode)) {
    return {ErrorKind::kUnavailable, name + " is not a socket"};
  }
  return {ErrorKind::kUnavailable, "no palpated at " + name + ": start it with 'palpated'"};
}

}  // namespace

Link::Link(const Address& address) {
  if (!address.socket_path.empty() && !address.host_port.empty()) {
    throw Error(ErrorKind::kInvalidArgument, "name a socket, or a host and port, not both");
  }
  if (address.host_port.empty()) {
    socket_path_ = address.socket_path.empty() ? DefaultSocketPath() : address.socket_path;
    target_ = name_ = UnixTarget(socket_path_);
  } else {
    const HostPort host_port = ParseHostPort(address.host_port);
    target_ = TcpTarget(host_port);
    name_ = host_port.ToString();
  }
  Renew();
}

std::shared_ptr<grpc::Channel> Link::channel() const {
  const std::lock_guard lock(mutex_);
  return channel_;
}

std::shared_ptr<grpc::Channel> Link::volume_channel() const {
  const std::lock_guard lock(mutex_);
  return volume_channel_;
}

void Link::Renew() {
  auto channel = MakeChannel(target_);
  auto volume_channel = MakeChannel(target_);
  const std::lock_guard lock(mutex_);
  channel_.swap(channel);
  volume_channel_.swap(volume_channel);
}

Error Link::ErrorOf(const grpc::Status& status) const {
  switch (status.error_code()) {
    case grpc::StatusCode::DEADLINE_EXCEEDED:
      return {ErrorKind::kUnavailable, "palpated at " + name_ + " does not answer"};
    case grpc::StatusCode::UNIMPLEMENTED:
      return {ErrorKind::kUnavailable,
              name_ + " is not palpated, or one of another version than this library"};
    case grpc::StatusCode::UNAVAILABLE:
      // The daemon's own line, where there is a daemon.
      if (channel()->GetState(false) == GRPC_CHANNEL_READY) return FromStatus(status);
      return WhyUnreached(socket_path_, name_);
    default:
      return FromStatus(status);
  }
}

void Link::CancelCalls() {
  const std::lock_guard lock(mutex_);
  cancelled_ = true;
  for (grpc::ClientContext* context : running_) context->TryCancel();
}

Link::Registered::Registered(Link& link, grpc::ClientContext& context)
    : link_(link), context_(context) {
  const std::lock_guard lock(link_.mutex_);
  if (link_.cancelled_) throw Error(ErrorKind::kCancelled, "the client is being destroyed");
  link_.running_.insert(&context_);
}

Link::Registered::~Registered() {
  const std::lock_guard lock(link_.mutex_);
  link_.running_.erase(&context_);
}

}  // namespace palpate::client
