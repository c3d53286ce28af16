// Where a palpated is, channels to it, and what keeps it from being reached.
//
// Threads: any, at once; a route does not change.
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <string>

#include "client/sdk/connection.h"
#include "client/sdk/server_choice.h"
#include "common/error/error.h"

namespace palpate::client {

class Route {
 public:
  // Connects nothing yet. Errors: kInvalidArgument for an address that is none, and for
  // credentials that could not be sent safely; kPermissionDenied as DefaultSocketPath.
  explicit Route(const Server& server);

  // "unix:/run/palpate/palpated.sock" or "localhost:7400", for people.
  const std::string& name() const { return name_; }
  // Empty over TCP.
  const std::string& socket_path() const { return socket_path_; }

  // Empty: no token is sent.
  const std::string& token_file() const { return credentials_.token_file; }

  // Reads the credentials' files anew, so that renewed ones are taken. Errors:
  // kNotFound, kInvalidArgument for such a file.
  std::shared_ptr<grpc::ChannelCredentials> MakeCredentials() const;
  std::shared_ptr<grpc::Channel> MakeChannel(
      const std::shared_ptr<grpc::ChannelCredentials>& credentials,
      const grpc::ChannelArguments& arguments) const;

  // Of a channel that does not connect, in a line that says what to do. `details`: what gRPC says
  // of a call on it. Of a socket gRPC reports all failures alike: the socket's file tells them
  // apart.
  Error WhyUnreached(const std::string& details) const;

 private:
  std::string WhyServerUnreached(const std::string& details) const;
  Error WhySocketUnreached() const;

  std::string name_;
  std::string socket_path_;
  std::string target_;
  bool has_tls_ = false;
  Credentials credentials_;
};

}  // namespace palpate::client
