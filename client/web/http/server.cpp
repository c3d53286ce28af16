#include "client/web/http/server.h"

#include <openssl/ssl.h>

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/system/system_error.hpp>
#include <chrono>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/web/http/guest.h"
#include "client/web/http/http_connection.h"
#include "client/web/http/networks.h"
#include "client/web/http/peer_stream.h"
#include "client/web/http/site.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

namespace asio = boost::asio;
using boost::asio::ip::tcp;
using ErrorCode = boost::system::error_code;

tcp::endpoint ParseEndpoint(const HostPort& listen) {
  ErrorCode problem;
  const auto address =
      asio::ip::make_address(listen.host == "localhost" ? "127.0.0.1" : listen.host, problem);
  if (problem) Refuse("cannot listen on " + listen.host + ": an IP address is needed");
  return {address, listen.port};
}

tcp::acceptor Listen(asio::io_context& io, const HostPort& listen) {
  const tcp::endpoint endpoint = ParseEndpoint(listen);
  try {
    tcp::acceptor acceptor(io, endpoint.protocol());
    acceptor.set_option(asio::socket_base::reuse_address(true));
    // Accepted sockets have the same bounds on what the system keeps for them.
    acceptor.set_option(asio::socket_base::receive_buffer_size(64 << 10));
    acceptor.set_option(asio::socket_base::send_buffer_size(256 << 10));
    acceptor.bind(endpoint);
    acceptor.listen();
    acceptor.non_blocking(true);
    return acceptor;
  } catch (const boost::system::system_error& error) {
    const bool is_in_use = error.code() == asio::error::address_in_use;
    throw Error(is_in_use ? ErrorKind::kConflict : ErrorKind::kUnavailable,
                "cannot listen on " + listen.ToString() + ": " + error.code().message());
  }
}

std::optional<asio::ssl::context> MakeTls(const HttpOptions& options) {
  if (options.certificate_file.empty() != options.key_file.empty()) {
    Refuse("TLS needs both certificate and key");
  }
  if (options.certificate_file.empty()) return std::nullopt;
  asio::ssl::context tls(asio::ssl::context::tls_server);
  SSL_CTX_set_min_proto_version(tls.native_handle(), TLS1_2_VERSION);
  SSL_CTX_set_options(tls.native_handle(), SSL_OP_NO_RENEGOTIATION);
  SSL_CTX_set_session_cache_mode(tls.native_handle(), SSL_SESS_CACHE_OFF);
  ErrorCode problem;
  tls.use_certificate_chain_file(options.certificate_file.string(), problem);
  if (problem) Refuse(options.certificate_file.string() + ": no certificate in PEM");
  tls.use_private_key_file(options.key_file.string(), asio::ssl::context::pem, problem);
  if (problem) Refuse(options.key_file.string() + ": not the certificate's key in PEM");
  return tls;
}

std::string AddressOfPeer(const tcp::socket& socket) {
  ErrorCode problem;
  const tcp::endpoint endpoint = socket.remote_endpoint(problem);
  return problem ? "unknown" : endpoint.address().to_string();
}

}  // namespace

// Accepts connections, and looks at guests now and then.
class HttpServer::Listener : public std::enable_shared_from_this<Listener> {
 public:
  Listener(asio::io_context& io, Hub& hub, HttpOptions options, AccessOptions access,
           HttpEvents events)
      : acceptor_(Listen(io, options.listen)),
        port_(acceptor_.local_endpoint().port()),
        tls_(MakeTls(options)),
        site_(std::make_shared<Site>(hub, std::move(options), std::move(access), std::move(events),
                                     port_)),
        sweep_(io),
        pause_(io) {}

  void Start() {
    Accept();
    Sweep();
  }

  void Stop() {
    is_stopped_ = true;
    ErrorCode ignored;
    acceptor_.close(ignored);
    sweep_.cancel();
    pause_.cancel();
    site_->connections.CloseAll();
  }

  std::uint16_t port() const { return port_; }
  const Site& site() const { return *site_; }

 private:
  void Accept() {
    acceptor_.async_accept([self = shared_from_this()](ErrorCode error, tcp::socket socket) {
      if (self->is_stopped_) return;
      if (error) return self->AcceptLater();
      self->Welcome(std::move(socket));
      self->Accept();
    });
  }

  // Without file descriptors, say: until some are free.
  void AcceptLater() {
    site_->log.Refused("full", "connections cannot be accepted", site_->now);
    pause_.expires_after(std::chrono::milliseconds(100));
    pause_.async_wait([self = shared_from_this()](ErrorCode) {
      if (!self->is_stopped_) self->Accept();
    });
  }

  void Welcome(tcp::socket socket) {
    std::string peer = AddressOfPeer(socket);
    auto ticket = site_->connections.Admit(NetworkOf(peer));
    if (ticket == nullptr) {
      site_->log.Refused("full", peer + ": too many connections", site_->now);
      return;
    }
    ErrorCode ignored;
    socket.set_option(tcp::no_delay(true), ignored);
    std::make_shared<HttpConnection>(site_, PeerStream(std::move(socket), tls_ ? &*tls_ : nullptr),
                                     std::move(ticket), std::move(peer))
        ->Start();
  }

  void Sweep() {
    site_->now = std::chrono::steady_clock::now();
    const std::vector<Guest*> guests = site_->guests;
    for (Guest* const guest : guests) guest->Check();
    sweep_.expires_after(site_->options.timeouts.sweep);
    sweep_.async_wait([self = shared_from_this()](ErrorCode) {
      if (!self->is_stopped_) self->Sweep();
    });
  }

  tcp::acceptor acceptor_;
  const std::uint16_t port_;
  std::optional<asio::ssl::context> tls_;
  const std::shared_ptr<Site> site_;
  asio::steady_timer sweep_, pause_;
  bool is_stopped_ = false;
};

HttpServer::HttpServer(asio::io_context& io, Hub& hub, HttpOptions options, AccessOptions access,
                       HttpEvents events)
    : listener_(std::make_shared<Listener>(io, hub, std::move(options), std::move(access),
                                           std::move(events))) {
  listener_->Start();
}

HttpServer::~HttpServer() { Stop(); }

std::uint16_t HttpServer::port() const { return listener_->port(); }

void HttpServer::Stop() { listener_->Stop(); }

HttpServer::Counts HttpServer::counts() const {
  const Site& site = listener_->site();
  Counts counts{site.connections.count(), site.connections.strangers(),
                static_cast<int>(site.guests.size()), site.bodies.bytes()};
  for (const Guest* guest : site.guests) counts.held_bytes += guest->held_bytes();
  return counts;
}

}  // namespace palpate::web
