#include "client/sdk/link.h"

#include <tuple>

#include "client/sdk/backoff.h"
#include "common/wire/status.h"

namespace palpate::client {
namespace {

grpc::ChannelArguments Arguments() {
  grpc::ChannelArguments arguments;
  // A connection of its own, and not one that channels to the same target share.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  // Of the volume's, where only that one breaks: the pose thread knows of nothing then.
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, Backoff::kFirst.count());
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, Backoff::kLongest.count());
  return arguments;
}

}  // namespace

Link::Link(const Server& server) : route_(server) {
  std::tie(channel_, volume_channel_) = MakeChannels();
}

std::pair<std::shared_ptr<grpc::Channel>, std::shared_ptr<grpc::Channel>> Link::MakeChannels()
    const {
  return {route_.MakeChannel(Arguments()), route_.MakeChannel(Arguments())};
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
  try {
    auto channels = MakeChannels();
    const std::lock_guard lock(mutex_);
    channel_.swap(channels.first);
    volume_channel_.swap(channels.second);
  } catch (const Error&) {
    // A file of credentials is being replaced: the next attempt reads it.
  }
}

Error Link::ErrorOf(const grpc::Status& status) const {
  switch (status.error_code()) {
    case grpc::StatusCode::DEADLINE_EXCEEDED:
      return {ErrorKind::kUnavailable, "palpated at " + name() + " does not answer"};
    case grpc::StatusCode::UNIMPLEMENTED:
      return {ErrorKind::kUnavailable,
              name() + " is not palpated, or one of another version than this library"};
    case grpc::StatusCode::UNAVAILABLE:
      // The daemon's own line, where there is a daemon.
      if (channel()->GetState(false) == GRPC_CHANNEL_READY) return FromStatus(status);
      return route_.WhyUnreached(status.error_message());
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
  if (link_.cancelled_) throw Error(ErrorKind::kCancelled, "the connection was closed");
  link_.running_.insert(&context_);
}

Link::Registered::~Registered() {
  const std::lock_guard lock(link_.mutex_);
  link_.running_.erase(&context_);
}

}  // namespace palpate::client
