#include "client/web/http/http_connection.h"

#include <boost/asio/buffer.hpp>
#include <boost/beast/http/error.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/write.hpp>
#include <boost/optional.hpp>
#include <cstdint>
#include <exception>
#include <utility>

#include "client/web/http/guest.h"
#include "client/web/http/networks.h"
#include "client/web/http/routes.h"

namespace palpate::web {
namespace {

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

}  // namespace

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

}  // namespace palpate::web
