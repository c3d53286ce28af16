// The channels to one palpated, and calls that can be cancelled: unary ones from another thread,
// those in steps while they wait.
//
// Threads: any.
#pragma once

#include <google/protobuf/message.h>
#include <grpcpp/grpcpp.h>

#include <chrono>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <utility>

#include "client/sdk/channel.h"
#include "client/sdk/connection.h"
#include "common/error/error.h"

namespace palpate::client {

// A call whose steps can all be cancelled: while it waits, it asks every 50 ms whether to go on.
// For one thread. Begin the call with PrepareAsync...(&context(), ..., &queue()) and the tag
// `this`, then follow each step with Wait(). End it with Finish().
class PolledCall {
 public:
  // `goes_on`: false cancels the call.
  PolledCall(grpc::ClientContext& context, std::function<bool()> goes_on)
      : context_(context), goes_on_(std::move(goes_on)) {}
  PolledCall(const PolledCall&) = delete;
  PolledCall& operator=(const PolledCall&) = delete;
  ~PolledCall() {
    queue_.Shutdown();
    void* tag = nullptr;
    bool ok = false;
    while (queue_.Next(&tag, &ok)) {
    }
  }

  grpc::ClientContext& context() { return context_; }
  grpc::CompletionQueue& queue() { return queue_; }
  bool is_cancelled() const { return is_cancelled_; }

  // Returns false if the step failed; Finish throws the reason.
  bool Wait() {
    void* tag = nullptr;
    bool ok = false;
    while (queue_.AsyncNext(&tag, &ok, std::chrono::system_clock::now() + kPoll) ==
           grpc::CompletionQueue::TIMEOUT) {
      Ask();
    }
    return ok;
  }
  void Ask() {
    if (is_cancelled_) return;
    try {
      is_cancelled_ = !goes_on_();
    } catch (...) {
      // Keep the exception for Finish: until then gRPC may write to the arguments of this step.
      thrown_ = std::current_exception();
      is_cancelled_ = true;
    }
    if (is_cancelled_) context_.TryCancel();
  }

  // Throws the exception of goes_on, if there is one.
  template <typename Call>
  grpc::Status Finish(Call& call) {
    grpc::Status status;
    call.Finish(&status, this);
    Wait();
    if (thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
    return status;
  }

 private:
  static constexpr std::chrono::milliseconds kPoll{50};
  grpc::ClientContext& context_;
  const std::function<bool()> goes_on_;
  bool is_cancelled_ = false;
  std::exception_ptr thrown_;
  grpc::CompletionQueue queue_;
};

inline constexpr std::chrono::seconds kCallTimeout{5};
inline constexpr std::size_t kSmallBytes = 32 << 10;

// Refuses a request with text that is not UTF-8, which palpated could not read.
void CheckText(const google::protobuf::Message& request);

class Link {
 public:
  // Does not connect. Errors: as Client's.
  explicit Link(const Server& server);

  std::string name() const { return route_.name(); }
  bool shares_clock() const { return route_.is_socket(); }
  // Each has a connection of its own. channel() is for calls and poses, volume_channel() for voxels
  // and uploads, stop_channel() for the emergency stop alone.
  std::shared_ptr<grpc::Channel> channel() const { return ChannelOf(&Channels::calls); }
  std::shared_ptr<grpc::Channel> volume_channel() const { return ChannelOf(&Channels::volume); }
  std::shared_ptr<grpc::Channel> stop_channel() const { return ChannelOf(&Channels::stop); }
  // Over the network, connects the stop's channel if it is not connected. Does not wait. Call it
  // about once a second, on one thread.
  void KeepStopReady();
  // Empty over TCP.
  std::string socket_path() const { return route_.socket_path(); }
  // Makes all channels new for an attempt to connect. A channel that has failed refuses all calls
  // until gRPC's own pause is over and gRPC has connected in the background. With the old channel,
  // an attempt or two would fail although the daemon is back.
  void Renew();

  // While this object exists, CancelCalls ends the call.
  class Registered {
   public:
    // Errors: kCancelled after CancelCalls.
    Registered(Link& link, grpc::ClientContext& context);
    ~Registered();
    Registered(const Registered&) = delete;
    Registered& operator=(const Registered&) = delete;

   private:
    Link& link_;
    grpc::ClientContext& context_;
  };

  // Calls a unary method of a service, for example
  //   Call<v1::RenderService>(&v1::RenderService::Stub::GetSettings, request)
  // own_channel: in place of channel(). Errors: the status as ErrorOf returns it.
  template <typename Service, typename Request, typename Response>
  Response Call(grpc::Status (Service::Stub::*method)(grpc::ClientContext*, const Request&,
                                                      Response*),
                const Request& request, std::chrono::milliseconds timeout = kCallTimeout,
                const std::shared_ptr<grpc::Channel>& own_channel = nullptr) {
    CheckText(request);
    // palpated takes only a small first call of a connection.
    if (request.ByteSizeLong() > kSmallBytes) WaitUntilReached(timeout);
    return WhenLoaded([&] {
      const std::unique_ptr<typename Service::Stub> stub =
          Service::NewStub(own_channel ? own_channel : channel());
      grpc::ClientContext context;
      context.set_deadline(std::chrono::system_clock::now() + timeout);
      const Registered registered(*this, context);
      Response response;
      const grpc::Status status = ((*stub).*method)(&context, request, &response);
      if (!status.ok()) throw ErrorOf(status);
      return response;
    });
  }

  // Repeats `attempt` while palpated loads its first volume.
  template <typename Attempt>
  auto WhenLoaded(const Attempt& attempt) {
    struct Waiting {
      ~Waiting() {
        if (has_waited && on_loading) on_loading("");
      }
      const std::function<bool(const std::string&)>& on_loading;
      bool has_waited = false;
    } waiting{on_loading_};
    while (true) {
      try {
        return attempt();
      } catch (const Error& error) {
        if (error.kind() != ErrorKind::kLoading || !WaitForLoading(error)) throw;
        waiting.has_waited = true;
      }
    }
  }
  // See Calls::SetOnLoading.
  void SetOnLoading(std::function<bool(const std::string&)> call) { on_loading_ = std::move(call); }

  // Calls a method that streams its answer to `request`, without a deadline.
  // prepare(stub, context, queue) starts the call, for example with
  // stub.PrepareAsyncLoadVolume(context, request, queue).
  // take(message) gets each message.
  // goes_on() is asked after each message and every 50 ms; false cancels the call.
  // Errors: the status as ErrorOfEnd returns it; kCancelled with the text `cancelled` if goes_on()
  // returned false.
  template <typename Service, typename Message, typename Prepare, typename Take>
  void Stream(const google::protobuf::Message& request, const Prepare& prepare, const Take& take,
              const std::function<bool()>& goes_on, const std::string& cancelled) {
    CheckText(request);
    WhenLoaded([&] { StreamOnce<Service, Message>(prepare, take, goes_on, cancelled); });
  }

  // Returns the Error for the status of a failed call.
  Error ErrorOf(const grpc::Status& status) const;
  // Returns the Error of a stream that palpated ended. If a client's token was revoked, palpated
  // ends the client's streams without a reason. So this function makes another call to learn the
  // reason.
  Error ErrorOfEnd(const grpc::Status& status);

  // Throws an Error that says why palpated is not reached within `timeout`. On this machine it may
  // be about to come: it is waited for.
  void WaitUntilReached(std::chrono::milliseconds timeout);

  // Cancels the running calls. Later calls fail at once.
  void CancelCalls();
  // Throws kCancelled after CancelCalls.
  void ThrowIfCancelled() const;

 private:
  template <typename Service, typename Message, typename Prepare, typename Take>
  void StreamOnce(const Prepare& prepare, const Take& take, const std::function<bool()>& goes_on,
                  const std::string& cancelled) {
    const std::unique_ptr<typename Service::Stub> stub = Service::NewStub(channel());
    grpc::ClientContext context;
    const Registered registered(*this, context);
    PolledCall polled(context, goes_on);
    const auto call = prepare(*stub, &context, &polled.queue());
    call->StartCall(&polled);
    polled.Wait();
    std::exception_ptr thrown;
    Message message;
    while (call->Read(&message, &polled), polled.Wait()) {
      try {
        take(std::as_const(message));
      } catch (...) {
        thrown = std::current_exception();
        context.TryCancel();
        break;
      }
      polled.Ask();
    }
    const grpc::Status status = polled.Finish(*call);
    if (thrown) std::rethrow_exception(thrown);
    if (status.ok()) return;
    throw polled.is_cancelled() ? Error(ErrorKind::kCancelled, cancelled) : ErrorOfEnd(status);
  }

  // Returns false if the caller does not want to wait.
  bool WaitForLoading(const Error& error) const;
  void TryToReach(std::chrono::milliseconds timeout) const;
  struct Channels {
    std::shared_ptr<grpc::Channel> calls, volume, stop;
  };
  Channels MakeChannels() const;
  std::shared_ptr<grpc::Channel> ChannelOf(std::shared_ptr<grpc::Channel> Channels::*which) const {
    const std::lock_guard lock(mutex_);
    return channels_.*which;
  }
  std::string WhatGrpcSays(const std::shared_ptr<grpc::Channel>& channel) const;

  const Route route_;
  std::function<bool(const std::string&)> on_loading_;
  bool stop_is_ready_ = false;  // of the thread that keeps it so

  mutable std::mutex mutex_;
  Channels channels_;
  std::set<grpc::ClientContext*> running_;
  bool cancelled_ = false;
};

}  // namespace palpate::client
