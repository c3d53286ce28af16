#include "client/cli/connection.h"

#include <sys/stat.h>

#include <chrono>
#include <cstdio>
#include <filesystem>

#include "client/cli/output.h"
#include "common/error/one_line.h"
#include "common/wire/status.h"
#include "palpate/v1/device.grpc.pb.h"

namespace palpate::cli {
namespace {

constexpr std::chrono::seconds kConnectTimeout(3);
constexpr std::chrono::seconds kCallTimeout(5);

Error WithOption(const Error& error, bool is_socket) {
  return {error.kind(),
          std::string(error.what()) + (is_socket ? ", or name another one with --socket"
                                                 : "; see --server, --tls-ca and --profile")};
}

}  // namespace

std::string TokenFileWarning(const std::string& path) {
  struct stat info {};
  if (path.empty() || stat(path.c_str(), &info) != 0 || (info.st_mode & S_IROTH) == 0) return "";
  return "the token file " + path +
         " may be read by every account of this machine: 'chmod 600' it, and ask for a new token "
         "where others could have read this one";
}

Connection::Connection(const client::Server& server)
    : route_(server), channel_(route_.MakeChannel({})) {
  const std::string warning = TokenFileWarning(route_.token_file());
  if (!warning.empty()) std::fprintf(stderr, "palpate: warning: %s\n", OneLine(warning).c_str());
  WaitUntilReady();
}

void Connection::WaitUntilReady() const {
  const auto deadline = std::chrono::system_clock::now() + kConnectTimeout;
  grpc_connectivity_state state = channel_->GetState(true);
  while (state != GRPC_CHANNEL_READY) {
    if (state == GRPC_CHANNEL_TRANSIENT_FAILURE || state == GRPC_CHANNEL_SHUTDOWN) {
      throw WithOption(route_.WhyUnreached(shares_clock() ? "" : WhatGrpcSays()), shares_clock());
    }
    if (!channel_->WaitForStateChange(state, deadline)) {
      throw WithOption({ErrorKind::kUnavailable,
                        "no answer from " + name() +
                            " within 3 s: a firewall drops what is sent, or it is not palpated"},
                       shares_clock());
    }
    state = channel_->GetState(true);
  }
}

// Of a channel that does not connect: a call on it has the reason.
std::string Connection::WhatGrpcSays() const {
  grpc::ClientContext context;
  SetDeadline(context);
  v1::GetDeviceResponse response;
  return v1::DeviceService::NewStub(channel_)->GetDevice(&context, {}, &response).error_message();
}

void Connection::SetDeadline(grpc::ClientContext& context) {
  context.set_deadline(std::chrono::system_clock::now() + kCallTimeout);
}

Error Connection::ErrorOf(const grpc::Status& status) const {
  switch (status.error_code()) {
    case grpc::StatusCode::DEADLINE_EXCEEDED:
      return {ErrorKind::kUnavailable, "palpated at " + name() + " did not answer within 5 s"};
    case grpc::StatusCode::UNIMPLEMENTED:
      return {ErrorKind::kUnavailable,
              name() +
                  " is not palpated, or one of another version: compare 'palpated --version' "
                  "and 'palpate --version'"};
    case grpc::StatusCode::UNAVAILABLE:
      return {ErrorKind::kUnavailable,
              "palpated at " + name() + " is unavailable: " + status.error_message()};
    default:
      return FromStatus(status);
  }
}

Error Connection::ErrorOfEnd(const grpc::Status& status) const {
  switch (status.error_code()) {
    case grpc::StatusCode::OK:
    case grpc::StatusCode::CANCELLED:
      break;
    case grpc::StatusCode::UNAVAILABLE:
      // The daemon's own line, where there is a daemon.
      if (channel_->GetState(false) == GRPC_CHANNEL_READY) return ErrorOf(status);
      break;
    default:
      return ErrorOf(status);
  }
  try {
    Call(*v1::DeviceService::NewStub(channel_), &v1::DeviceService::Stub::GetDevice,
         v1::GetDeviceRequest());
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::kPermissionDenied) return error;
  }
  return {ErrorKind::kUnavailable,
          "palpated at " + name() + " went away: start it again, then repeat this"};
}

std::string PathThere(const std::string& path, bool is_here, const std::string& name) {
  if (path.empty()) throw Error(ErrorKind::kInvalidArgument, "the path is empty: name a file");
  if (std::filesystem::path(path).is_absolute()) return path;
  if (is_here) return std::filesystem::absolute(path).string();
  throw Error(ErrorKind::kInvalidArgument,
              "'" + path + "' is a relative path, and palpated at " + name +
                  " may be on another machine: give the absolute path there");
}

}  // namespace palpate::cli
