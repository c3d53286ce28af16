// The channel to palpated, and its errors in words.
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <string>

#include "client/sdk/channel.h"
#include "common/error/error.h"

namespace palpate::cli {

// What to warn of where others may read the file with our token; empty: nothing.
std::string TokenFileWarning(const std::string& path);

// A path for a palpated, whose current folder is another one than ours. `is_here`: it runs on this
// machine; `name`: for people. Errors: kInvalidArgument for an empty path, and for a relative one
// where the daemon may be on another machine.
std::string PathThere(const std::string& path, bool is_here, const std::string& name);

// Threads: main only, but the channel is as thread-safe as any of gRPC.
class Connection {
 public:
  // Connects within 3 s. Warns on stderr of a token file that others may read.
  // Errors: Error saying what to do; kUnavailable when nothing answers there,
  // kPermissionDenied, kInvalidArgument for an address that is none.
  explicit Connection(const client::Server& server);

  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }
  // For people: "unix:/run/palpate/palpated.sock" or "localhost:7400".
  const std::string& name() const { return route_.name(); }
  // The daemon runs on this machine, so that its clock is ours. Unknown over
  // TCP, hence false.
  bool shares_clock() const { return !route_.socket_path().empty(); }

  // Calls a unary method with a deadline of 5 s, for example
  //   Call(*v1::RenderService::NewStub(c.channel()),
  //        &v1::RenderService::Stub::GetSettings, v1::GetSettingsRequest())
  // Errors: ErrorOf the status.
  template <typename Stub, typename Request, typename Response>
  Response Call(Stub& stub,
                grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
                const Request& request) const {
    grpc::ClientContext context;
    SetDeadline(context);
    Response response;
    if (const grpc::Status status = (stub.*method)(&context, request, &response); !status.ok()) {
      throw ErrorOf(status);
    }
    return response;
  }

  // The Error to end with after a failed status.
  Error ErrorOf(const grpc::Status& status) const;
  // Of a stream that palpated ended, without a word where it takes us for a stranger by now:
  // another call has the reason.
  Error ErrorOfEnd(const grpc::Status& status) const;

  std::string PathThere(const std::string& path) const {
    return cli::PathThere(path, shares_clock(), name());
  }

 private:
  static void SetDeadline(grpc::ClientContext& context);
  void WaitUntilReady() const;
  std::string WhatGrpcSays() const;

  const client::Route route_;
  std::shared_ptr<grpc::Channel> channel_;
};

}  // namespace palpate::cli
