// The channels to one palpated, and unary calls on them that one can end from outside.
//
// Threads: any.
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <utility>

#include "client/sdk/channel.h"
#include "client/sdk/connection.h"
#include "common/error/error.h"

namespace palpate::client {

inline constexpr std::chrono::seconds kCallTimeout{5};

class Link {
  template <typename Message>
  static Message MessageOfReader(const grpc::ClientReader<Message>*);
  template <typename Reader>
  using MessageOf = decltype(MessageOfReader(static_cast<Reader>(nullptr)));

 public:
  // Connects nothing yet. Errors: as Client's.
  explicit Link(const Server& server);

  const std::string& name() const { return route_.name(); }
  bool shares_clock() const { return !route_.socket_path().empty(); }
  // For calls and poses; and one for voxels.
  std::shared_ptr<grpc::Channel> channel() const;
  std::shared_ptr<grpc::Channel> volume_channel() const;
  // Both anew, for an attempt to connect. One that has failed refuses all calls until
  // a pause of gRPC's own is over and it has connected in the background, so that a
  // daemon that is back would be found an attempt or two too late.
  void Renew();

  // Calls a unary method of a service, for example
  //   Call<v1::RenderService>(&v1::RenderService::Stub::GetSettings, request)
  // Errors: ErrorOf its status.
  template <typename Service, typename Request, typename Response>
  Response Call(grpc::Status (Service::Stub::*method)(grpc::ClientContext*, const Request&,
                                                      Response*),
                const Request& request, std::chrono::milliseconds timeout = kCallTimeout) {
    const std::unique_ptr<typename Service::Stub> stub = Service::NewStub(channel());
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + timeout);
    const Registered registered(*this, context);
    Response response;
    if (const grpc::Status status = ((*stub).*method)(&context, request, &response); !status.ok()) {
      throw ErrorOf(status);
    }
    return response;
  }

  // Calls a method that streams its answer, without a deadline: open(stub, context) begins it.
  // take(message): false cancels.
  // Errors: ErrorOf its status.
  template <typename Service, typename Open, typename Take>
  void Stream(const Open& open, const Take& take) {
    const std::unique_ptr<typename Service::Stub> stub = Service::NewStub(channel());
    grpc::ClientContext context;
    const Registered registered(*this, context);
    const auto reader = open(*stub, context);
    for (MessageOf<decltype(reader.get())> message; reader->Read(&message);) {
      if (!take(std::as_const(message))) context.TryCancel();
    }
    if (const grpc::Status status = reader->Finish(); !status.ok()) throw ErrorOf(status);
  }

  // The Error that a failed call, or an ended stream, stands for.
  Error ErrorOf(const grpc::Status& status) const;

  // Ends the calls that run, and all later ones at once.
  void CancelCalls();

 private:
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

  std::pair<std::shared_ptr<grpc::Channel>, std::shared_ptr<grpc::Channel>> MakeChannels() const;

  const Route route_;

  mutable std::mutex mutex_;
  std::shared_ptr<grpc::Channel> channel_;
  std::shared_ptr<grpc::Channel> volume_channel_;
  std::set<grpc::ClientContext*> running_;
  bool cancelled_ = false;
};

}  // namespace palpate::client
