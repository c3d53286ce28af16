#include "client/web/http/server.h"

#include <openssl/ssl.h>

#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/error.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
#include <boost/optional.hpp>
#include <boost/system/system_error.hpp>
#include <chrono>
#include <cstdint>
#include <exception>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/web/http/answer.h"
#include "client/web/http/connections.h"
#include "client/web/http/guest.h"
#include "client/web/http/peer_stream.h"
#include "client/web/http/routes.h"
#include "client/web/http/site.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

// A browser's connection: reads requests, one at a time, and writes what Route answers.
//
// Lives as long as an operation on its socket is under way. Threads: the network thread.
class HttpConnection : public std::enable_shared_from_this<HttpConnection> {
 public:
  static constexpr std::size_t kMaxHeaderBytes = 8 << 10;
  static constexpr std::size_t kMaxBodyBytes = 4 << 10;

  // `peer`: its address, without port.
  HttpConnection(std::shared_ptr<Site> site, PeerStream stream,
                 std::unique_ptr<Connections::Ticket> ticket, std::string peer);
  void Start();

 private:
  using Parser = boost::beast::http::request_parser<boost::beast::http::string_body>;
  using ErrorCode = boost::beast::error_code;

  void Read(std::chrono::milliseconds patience);
  void OnRequest(ErrorCode error);
  void RefuseMalformed(ErrorCode error);
  void Join(SessionPtr session);
  void Write(Answer answer, unsigned version, bool keep_alive);
  void Linger(int reads);

  const std::shared_ptr<Site> site_;
  PeerStream stream_;
  std::unique_ptr<Connections::Ticket> ticket_;
  const std::string peer_;
  boost::beast::flat_buffer buffer_;
  std::optional<Parser> parser_;
  std::array<char, 4096> discarded_;
};

namespace asio = boost::asio;
namespace http = boost::beast::http;

// A response's body that is shared with others, and not copied.
struct SharedBody {
  using value_type = Body;
  static std::uint64_t size(const Body& body) { return body ? body->size() : 0; }
  class writer {
   public:
    using const_buffers_type = asio::const_buffer;
    template <bool is_request, class Fields>
    writer(const http::header<is_request, Fields>&, const Body& body) : body_(body) {}
    void init(boost::beast::error_code& error) { error = {}; }
    boost::optional<std::pair<const_buffers_type, bool>> get(boost::beast::error_code& error) {
      error = {};
      if (!body_) return boost::none;
      return {{asio::buffer(*body_), false}};
    }

   private:
    const Body& body_;
  };
};
using Response = http::response<SharedBody>;

Response ToResponse(const Answer& answer, unsigned version, bool keep_alive) {
  Response response(answer.status, version);
  AddProtection(response);
  for (const auto& [field, value] : answer.fields) response.set(field, value);
  response.keep_alive(keep_alive);
  response.body() = answer.body;
  const bool has_no_body =
      answer.status == http::status::no_content || answer.status == http::status::not_modified;
  if (has_no_body) return response;
  response.set(http::field::content_type,
               boost::beast::string_view(answer.content_type.data(), answer.content_type.size()));
  response.prepare_payload();
  return response;
}

HttpConnection::HttpConnection(std::shared_ptr<Site> site, PeerStream stream,
                               std::unique_ptr<Connections::Ticket> ticket, std::string peer)
    : site_(std::move(site)),
      stream_(std::move(stream)),
      ticket_(std::move(ticket)),
      peer_(std::move(peer)),
      buffer_(kMaxHeaderBytes + kMaxBodyBytes) {}

void HttpConnection::Start() {
  ticket_->close = [weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->stream_.Close();
  };
  const std::chrono::milliseconds patience = site_->options.timeouts.request;
  stream_.tcp().expires_after(patience);
  stream_.AsyncHandshake([self = shared_from_this(), patience](ErrorCode error) {
    if (!error) return self->Read(patience);
    self->site_->log.Refused("tls", self->peer_ + ": " + error.message(), self->site_->now);
  });
}

void HttpConnection::Read(std::chrono::milliseconds patience) {
  ticket_->use = Connections::Ticket::Use::kIdle;
  parser_.emplace();
  parser_->header_limit(kMaxHeaderBytes);
  parser_->body_limit(kMaxBodyBytes);
  stream_.tcp().expires_after(patience);
  http::async_read(
      stream_, buffer_, *parser_,
      [self = shared_from_this()](ErrorCode error, std::size_t) { self->OnRequest(error); });
}

void HttpConnection::OnRequest(ErrorCode error) {
  ticket_->use = Connections::Ticket::Use::kRequest;
  if (error) return RefuseMalformed(error);
  const auto& request = parser_->get();
  Answer answer;
  try {
    answer = Route(*site_, request, peer_);
  } catch (const std::exception& problem) {
    site_->log.Refused("internal", problem.what(), site_->now);
    answer = TextAnswer(http::status::internal_server_error, "internal error: see the log");
  }
  if (answer.session) ticket_->LoggedIn(answer.session);
  ticket_->peer = NetworkOf(AddressOf(*site_, request, peer_));
  if (answer.joins && buffer_.size() == 0) return Join(answer.session);
  if (answer.joins) answer = TextAnswer(http::status::bad_request, "wait for the answer");
  Write(std::move(answer), request.version(), request.keep_alive());
}

// What the socket's end or a time-out says is no refusal, for browsers close idle connections.
void HttpConnection::RefuseMalformed(ErrorCode error) {
  if (error == http::error::end_of_stream || error == http::error::partial_message ||
      error.category() != make_error_code(http::error::bad_method).category()) {
    if (error == boost::beast::error::timeout && buffer_.size() > 0) {
      site_->log.Refused("slow", peer_ + ": a request did not end", site_->now);
    }
    return;
  }
  Answer answer = TextAnswer(http::status::bad_request, "malformed request");
  if (error == http::error::header_limit || error == http::error::buffer_overflow) {
    answer = TextAnswer(http::status::request_header_fields_too_large, "the header is too large");
  } else if (error == http::error::body_limit) {
    answer = TextAnswer(http::status::payload_too_large, "the body is too large");
  }
  site_->log.Refused("malformed", peer_ + ": " + error.message(), site_->now);
  Write(std::move(answer), 11, false);
}

void HttpConnection::Join(SessionPtr session) {
  std::make_shared<Guest>(site_, std::move(stream_), std::move(ticket_), std::move(session), peer_)
      ->Start(parser_->get());
}

void HttpConnection::Write(Answer answer, unsigned version, bool keep_alive) {
  const std::string& peer = ticket_->peer;
  const HeldBodies::Holder holder =
      answer.session ? HeldBodies::Holder{answer.session->network, answer.session->user}
                     : HeldBodies::Holder{peer, peer};
  if (!site_->bodies.Hold(answer.body, holder)) {
    site_->log.Refused("memory", peer_ + ": slow readers hold too much", site_->now);
    answer = TextAnswer(http::status::service_unavailable, "too many slow readers");
    site_->bodies.Hold(answer.body, holder);
  }
  const std::size_t bytes = answer.body ? answer.body->size() : 0;
  if (site_->events.answered) site_->events.answered(static_cast<int>(answer.status), bytes);
  const HttpTimeouts& timeouts = site_->options.timeouts;
  stream_.tcp().expires_after(timeouts.write +
                              std::chrono::milliseconds(bytes / timeouts.lowest_bytes_per_ms));
  auto response = std::make_shared<Response>(ToResponse(answer, version, keep_alive));
  http::async_write(stream_, *response,
                    [self = shared_from_this(), response, body = answer.body, holder, keep_alive](
                        ErrorCode error, std::size_t) {
                      self->site_->bodies.Release(body, holder);
                      if (error) return;
                      if (!keep_alive) return self->Linger(16);
                      self->Read(self->site_->options.timeouts.keep_alive);
                    });
}

// Reads for a while what still comes: closing a socket with unread data would take the answer back.
void HttpConnection::Linger(int reads) {
  ErrorCode ignored;
  stream_.tcp().socket().shutdown(asio::ip::tcp::socket::shutdown_send, ignored);
  if (reads == 0) return;
  stream_.tcp().expires_after(std::chrono::seconds(1));
  stream_.tcp().async_read_some(asio::buffer(discarded_),
                                [self = shared_from_this(), reads](ErrorCode error, std::size_t) {
                                  if (!error) self->Linger(reads - 1);
                                });
}

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
