#include "client/sdk/link.h"

#include <google/protobuf/message.h>

#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/sdk/backoff.h"
#include "common/error/text.h"
#include "common/wire/status.h"
#include "palpate/v1/device.grpc.pb.h"

namespace palpate::client {
namespace {

grpc::ChannelArguments Arguments() {
  grpc::ChannelArguments arguments;
  // Use a connection of its own. By default, channels to the same target share a connection.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  // gRPC's own pauses. They matter if only the volume's connection breaks, because the pose thread
  // does not see that loss.
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, Backoff::kFirst.count());
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, Backoff::kLongest.count());
  return arguments;
}

// gRPC's probes of the connection got no answer (channel.cpp).
bool IsStalled(const grpc::Status& status) {
  return status.error_code() == grpc::StatusCode::UNAVAILABLE &&
         status.error_message().find("keepalive") != std::string::npos;
}

Error ClosedError() { return {ErrorKind::kCancelled, "the connection was closed"}; }

}  // namespace

Link::Link(const Server& server) : route_(server) { channels_ = MakeChannels(); }

Link::Channels Link::MakeChannels() const {
  // Read the credentials once: a token may come through a pipe.
  const auto credentials = route_.MakeCredentials();
  return {route_.MakeChannel(credentials, Arguments()),
          route_.MakeChannel(credentials, Arguments()),
          route_.MakeChannel(credentials, Arguments())};
}

void Link::KeepStopReady() {
  if (shares_clock()) return;
  const std::shared_ptr<grpc::Channel> channel = stop_channel();
  const bool is_ready = channel->GetState(/*try_to_connect=*/true) == GRPC_CHANNEL_READY;
  if (std::exchange(stop_is_ready_, is_ready) || !is_ready) return;
  // Until its first call, palpated takes a connection for a stranger's.
  struct Greeting {
    explicit Greeting(const std::shared_ptr<grpc::Channel>& to)
        : stub(v1::DeviceService::NewStub(to)) {}
    std::unique_ptr<v1::DeviceService::Stub> stub;
    grpc::ClientContext context;
    v1::GetDeviceRequest request;
    v1::GetDeviceResponse response;
  };
  const auto greeting = std::make_shared<Greeting>(channel);
  greeting->context.set_deadline(std::chrono::system_clock::now() + kCallTimeout);
  greeting->stub->async()->GetDevice(&greeting->context, &greeting->request, &greeting->response,
                                     [greeting](const grpc::Status&) {});
}

void Link::Renew() {
  if (!route_.CanReadAgain()) return;
  try {
    Channels channels = MakeChannels();
    const std::lock_guard lock(mutex_);
    std::swap(channels_, channels);
  } catch (const Error&) {
    // A file of the credentials is being replaced; the next attempt reads it again.
  }
}

bool Link::WaitForLoading(const Error& error) const {
  constexpr std::chrono::milliseconds kPause{200};
  if (on_loading_ && !on_loading_(error.what())) return false;
  std::this_thread::sleep_for(kPause);
  ThrowIfCancelled();
  return true;
}

void CheckText(const google::protobuf::Message& request) {
  using google::protobuf::FieldDescriptor;
  const google::protobuf::Reflection& reflection = *request.GetReflection();
  std::vector<const FieldDescriptor*> fields;
  reflection.ListFields(request, &fields);
  std::string held;
  for (const FieldDescriptor* field : fields) {
    const bool is_text = field->type() == FieldDescriptor::TYPE_STRING;
    if (!is_text && field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) continue;
    const int count = field->is_repeated() ? reflection.FieldSize(request, field) : 1;
    for (int n = 0; n < count; ++n) {
      if (!is_text) {
        CheckText(field->is_repeated() ? reflection.GetRepeatedMessage(request, field, n)
                                       : reflection.GetMessage(request, field));
        continue;
      }
      const std::string& text =
          field->is_repeated() ? reflection.GetRepeatedStringReference(request, field, n, &held)
                               : reflection.GetStringReference(request, field, &held);
      if (Utf8(text) == text) continue;
      throw Error(ErrorKind::kInvalidArgument,
                  "'" + Utf8(text) +
                      "' is not in UTF-8, but perhaps in Latin-1; palpated takes UTF-8 alone: "
                      "rename the file, or set the terminal to UTF-8");
    }
  }
}

Error Link::ErrorOf(const grpc::Status& status) const {
  if (const Error error = FromStatus(status); error.kind() == ErrorKind::kLoading) return error;
  if (IsStalled(status)) {
    return {ErrorKind::kUnavailable, "nothing comes from palpated at " + name() +
                                         ": the network is gone, or palpated hangs"};
  }
  switch (status.error_code()) {
    case grpc::StatusCode::DEADLINE_EXCEEDED:
      return {ErrorKind::kUnavailable, "palpated at " + name() + " does not answer"};
    case grpc::StatusCode::CANCELLED: {
      // We did not ask for it: gRPC gives it to calls of a daemon that ends.
      const std::lock_guard lock(mutex_);
      if (cancelled_) return ClosedError();
      return {ErrorKind::kUnavailable, "palpated at " + name() + " went away"};
    }
    case grpc::StatusCode::UNIMPLEMENTED:
      return {ErrorKind::kUnavailable,
              name() +
                  " is not palpated, or one of another version: compare its 'palpated "
                  "--version' with that of this program"};
    case grpc::StatusCode::UNAVAILABLE:
      // The text is the daemon's, or that of a channel that has not noticed its end yet.
      if (channel()->GetState(false) == GRPC_CHANNEL_READY) {
        return {ErrorKind::kUnavailable, "palpated at " + name() + ": " + status.error_message()};
      }
      return route_.WhyUnreached(status.error_message());
    default:
      return FromStatus(status);
  }
}

Error Link::ErrorOfEnd(const grpc::Status& status) {
  {
    const std::lock_guard lock(mutex_);
    if (cancelled_) return ClosedError();
  }
  switch (status.error_code()) {
    case grpc::StatusCode::OK:
    case grpc::StatusCode::CANCELLED:
      break;
    case grpc::StatusCode::UNAVAILABLE:
      if (IsStalled(status) || channel()->GetState(false) == GRPC_CHANNEL_READY) {
        return ErrorOf(status);
      }
      break;
    default:
      return ErrorOf(status);
  }
  try {
    Call<v1::DeviceService>(&v1::DeviceService::Stub::GetDevice, v1::GetDeviceRequest());
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::kPermissionDenied) return error;
  }
  return {ErrorKind::kUnavailable,
          "palpated at " + name() + " went away: start it again, then repeat this"};
}

void Link::WaitUntilReached(std::chrono::milliseconds timeout) {
  constexpr std::chrono::seconds kStart{2};
  constexpr std::chrono::milliseconds kPause{50};
  const auto started_by = std::chrono::steady_clock::now() + kStart;
  while (true) {
    try {
      return TryToReach(timeout);
    } catch (const Error& error) {
      const bool may_come = route_.is_here() && error.kind() == ErrorKind::kUnavailable;
      if (!may_come || std::chrono::steady_clock::now() > started_by) throw;
    }
    std::this_thread::sleep_for(kPause);
    Renew();
  }
}

void Link::TryToReach(std::chrono::milliseconds timeout) const {
  ThrowIfCancelled();
  const std::shared_ptr<grpc::Channel> reached = channel();
  const auto deadline = std::chrono::system_clock::now() + timeout;
  for (grpc_connectivity_state state = reached->GetState(true); state != GRPC_CHANNEL_READY;
       state = reached->GetState(true)) {
    if (state == GRPC_CHANNEL_TRANSIENT_FAILURE || state == GRPC_CHANNEL_SHUTDOWN) {
      throw route_.WhyUnreached(shares_clock() ? "" : WhatGrpcSays(reached));
    }
    if (reached->WaitForStateChange(state, deadline)) continue;
    throw Error(ErrorKind::kUnavailable,
                "no answer from " + name() + " within " +
                    std::to_string(std::chrono::ceil<std::chrono::seconds>(timeout).count()) +
                    " s: a firewall drops what is sent, or it is not palpated");
  }
}

// Makes a call on a channel that does not connect. The call's error has the reason.
std::string Link::WhatGrpcSays(const std::shared_ptr<grpc::Channel>& channel) const {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kCallTimeout);
  v1::GetDeviceResponse response;
  return v1::DeviceService::NewStub(channel)->GetDevice(&context, {}, &response).error_message();
}

void Link::ThrowIfCancelled() const {
  const std::lock_guard lock(mutex_);
  if (cancelled_) throw ClosedError();
}

void Link::CancelCalls() {
  const std::lock_guard lock(mutex_);
  cancelled_ = true;
  for (grpc::ClientContext* context : running_) context->TryCancel();
}

Link::Registered::Registered(Link& link, grpc::ClientContext& context)
    : link_(link), context_(context) {
  const std::lock_guard lock(link_.mutex_);
  if (link_.cancelled_) throw ClosedError();
  link_.running_.insert(&context_);
}

Link::Registered::~Registered() {
  const std::lock_guard lock(link_.mutex_);
  link_.running_.erase(&context_);
}

}  // namespace palpate::client
