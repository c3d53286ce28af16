// Counts, for the watch over a connection, what its calls read and answer. As an interceptor
// of gRPC's, so that no call is left out.
//
// Threads: gRPC's. Ownership: belongs to the server; the watch outlives it.
#pragma once

#include <grpcpp/support/server_interceptor.h>

#include "server/rpc/connection_watch.h"

namespace palpate {

// Messages of all services are Protobuf's; gRPC's own health service has others.
class ReadCounterFactory final : public grpc::experimental::ServerInterceptorFactoryInterface {
 public:
  explicit ReadCounterFactory(const ConnectionWatch& watch) : watch_(watch) {}
  grpc::experimental::Interceptor* CreateServerInterceptor(
      grpc::experimental::ServerRpcInfo* info) override;

 private:
  const ConnectionWatch& watch_;
};

}  // namespace palpate
