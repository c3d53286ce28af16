// The address of a palpated, channels to it, and the reason why it is not reached.
//
// Threads: any. A Route does not change.
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <optional>
#include <string>

#include "client/sdk/connection.h"
#include "client/sdk/server_choice.h"
#include "common/error/error.h"

namespace palpate::client {

class Route {
 public:
  // Does not connect. Errors: kInvalidArgument (a malformed address, or credentials that could not
  // be sent safely), kPermissionDenied as DefaultSocketPath.
  explicit Route(const Server& server);

  // "unix:/run/palpate/palpated.sock" or "localhost:7400", for people.
  std::string name() const;
  // True for this machine, where palpated may just be being started.
  bool is_here() const { return is_here_; }
  bool is_socket() const { return socket_.has_value(); }
  // Empty over TCP. Without a role, another one beside the same usual socket may be the highest
  // later, when palpated has started.
  std::string socket_path() const;

  // Empty: no token is sent.
  const std::string& token_file() const { return credentials_.token_file; }

  // Reads the files of the credentials again, so that renewed files are used. Errors: kNotFound,
  // kInvalidArgument for a file.
  std::shared_ptr<grpc::ChannelCredentials> MakeCredentials() const;
  // False if one of the files is a pipe: to read it again would wait for ever.
  bool CanReadAgain() const;
  std::shared_ptr<grpc::Channel> MakeChannel(
      const std::shared_ptr<grpc::ChannelCredentials>& credentials,
      const grpc::ChannelArguments& arguments) const;

  // Explains in one line why a channel does not connect, and what to do. `details`: gRPC's text of
  // a failed call on the channel. gRPC reports all failures of a socket alike, so the socket's file
  // is checked, too.
  Error WhyUnreached(const std::string& details) const;

 private:
  std::string WhyServerUnreached(const std::string& details) const;
  Error WhySocketUnreached() const;

  std::optional<Address> socket_;  // none: TCP
  std::string host_port_;
  std::string target_;
  bool has_tls_ = false;
  bool is_here_ = true;
  Credentials credentials_;
};

}  // namespace palpate::client
