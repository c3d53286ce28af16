// The server for browsers: the page, logins, the volume's blobs, and a WebSocket for each guest.
//
// Boost.Beast parses HTTP and WebSocket. All limits are in http_options.h, server.cpp,
// guest.h and access.
//
// Threads: the one that runs `io`, which is the hub's, too. Errors: the constructor throws Error
// (options that cannot be used, kConflict: an address in use, unreadable files).
#pragma once

#include <boost/asio/io_context.hpp>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "client/web/http/http_options.h"
#include "client/web/hub/hub.h"
#include "client/web/logins/access.h"

namespace palpate::web {

class HttpServer {
 public:
  // Listens from now on. `hub` must outlive the server.
  HttpServer(boost::asio::io_context& io, Hub& hub, HttpOptions options, AccessOptions access,
             HttpEvents events);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  std::uint16_t port() const;
  // Closes all connections and listens no more. Calls nothing of the hub afterwards.
  void Stop();

  struct Counts {
    int connections = 0;
    int strangers = 0;           // of these, without a login
    int guests = 0;              // of these, WebSockets
    std::size_t held_bytes = 0;  // of messages and answers that are being written
  };
  Counts counts() const;

 private:
  class Listener;
  std::shared_ptr<Listener> listener_;
};

}  // namespace palpate::web
