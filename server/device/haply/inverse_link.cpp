#include "server/device/haply/inverse_link.h"

#include <poll.h>

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <deque>
#include <utility>

#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using Clock = std::chrono::steady_clock;
using std::chrono::microseconds;
using std::chrono::milliseconds;
using ErrorCode = boost::system::error_code;
using WebSocket = beast::websocket::stream<beast::tcp_stream>;

constexpr milliseconds kLook{20};
// A peer that sends without end must not keep the thread in its handlers.
constexpr int kMostHandlers = 256;

asio::ip::tcp::endpoint Loopback(std::uint16_t port) {
  return {asio::ip::address_v4::loopback(), port};
}

// Runs an operation that was begun until it has ended. Returns false at `end` or `stop`.
bool Finish(asio::io_context& context, const bool& is_done, Clock::time_point end,
            const std::atomic<bool>& stop) {
  context.restart();
  while (!is_done && !stop && Clock::now() < end) {
    context.run_one_for(kLook);
    context.restart();
  }
  return is_done;
}

// A connected WebSocket, which collects its messages.
class Line {
 public:
  // is_asked: more than kMostMessages that nobody has taken end the line. Otherwise reading pauses
  // until they are taken.
  Line(asio::io_context& context, bool is_asked)
      : context_(context), socket_(context), is_asked_(is_asked) {}

  // "": connected. Else why not.
  std::string Connect(std::uint16_t port, milliseconds longest, const std::atomic<bool>& stop) {
    const Clock::time_point until = Clock::now() + longest;
    bool is_done = false;
    ErrorCode error;
    const auto end = [&](ErrorCode code) {
      error = code;
      is_done = true;
    };
    beast::get_lowest_layer(socket_).async_connect(Loopback(port), end);
    if (!Finish(context_, is_done, until, stop)) return Abandon("no answer in time");
    if (error) return error.message();
    beast::get_lowest_layer(socket_).socket().set_option(asio::ip::tcp::no_delay(true), error);
    socket_.read_message_max(InverseLink::kMostBytes);
    is_done = false;
    socket_.async_handshake("127.0.0.1:" + std::to_string(port), "/", end);
    if (!Finish(context_, is_done, until, stop)) return Abandon("no answer in time");
    if (error) return error.message();
    Read();
    return "";
  }

  bool TrySend(std::string_view text) {
    if (is_writing_) return false;
    is_writing_ = true;
    sent_.assign(text);
    socket_.text(true);
    socket_.async_write(asio::buffer(sent_), [this](ErrorCode error, std::size_t) {
      is_writing_ = false;
      if (error && ended_.empty()) ended_ = error.message();
    });
    return true;
  }

  void Close(milliseconds longest) {
    static const std::atomic<bool> kNever{false};
    bool is_done = !ended_.empty();
    if (!is_done)
      socket_.async_close(beast::websocket::close_code::normal, [&](ErrorCode) { is_done = true; });
    if (!Finish(context_, is_done, Clock::now() + longest, kNever)) Abandon("");
  }

  // To poll for more; -1: there is nothing to wait for.
  int handle() {
    return is_paused_ ? -1 : beast::get_lowest_layer(socket_).socket().native_handle();
  }
  std::optional<InverseLink::Message> Take() {
    if (messages_.empty()) return std::nullopt;
    InverseLink::Message message = std::move(messages_.front());
    messages_.pop_front();
    if (ended_.empty() && std::exchange(is_paused_, false)) Read();
    return message;
  }
  // Why there is no more to take; "": there may be.
  std::string ended() const { return messages_.empty() ? ended_ : ""; }

 private:
  // Ends what is under way: its handlers run before this returns.
  std::string Abandon(std::string reason) {
    beast::get_lowest_layer(socket_).close();
    context_.restart();
    context_.poll();
    return reason;
  }

  void Read() {
    socket_.async_read(buffer_, [this](ErrorCode error, std::size_t) {
      if (error) {
        ended_ = error.message();
        return;
      }
      messages_.push_back(
          {.text = socket_.got_text() ? beast::buffers_to_string(buffer_.cdata()) : std::string(),
           .time_ns = MonotonicNowNs()});
      buffer_.consume(buffer_.size());
      if (messages_.size() < InverseLink::kMostMessages) return Read();
      is_paused_ = true;
      if (is_asked_) ended_ = "it sends what nobody asked for";
    });
  }

  asio::io_context& context_;
  WebSocket socket_;
  beast::flat_buffer buffer_;
  std::string sent_;
  const bool is_asked_;
  bool is_paused_ = false;
  bool is_writing_ = false;
  std::deque<InverseLink::Message> messages_;
  std::string ended_;
};

}  // namespace

struct InverseLink::Impl {
  asio::io_context context{1};
  std::optional<Line> line{};
  std::optional<Line> events{};
};

InverseLink::InverseLink(std::uint16_t port, milliseconds longest, const std::atomic<bool>& stop)
    : impl_(std::make_unique<Impl>()) {
  const std::string problem =
      impl_->line.emplace(impl_->context, true).Connect(port, longest, stop);
  if (problem.empty()) return;
  throw BusError(BusFault::kAbsent, "no service at 127.0.0.1:" + std::to_string(port) + " (" +
                                        problem +
                                        "): install Haply's Inverse service and start it "
                                        "(systemctl start haply-inverse-service), or set [device] "
                                        "haply_port");
}

InverseLink::~InverseLink() = default;

bool InverseLink::ListenToEvents(std::uint16_t port, milliseconds longest,
                                 const std::atomic<bool>& stop) {
  if (impl_->events.emplace(impl_->context, false).Connect(port, longest, stop).empty())
    return true;
  impl_->events.reset();
  return false;
}

// The context's own wait has steps of whole ms.
void InverseLink::Wait(microseconds longest) {
  Impl& impl = *impl_;
  int handlers = 0;
  const auto run = [&] {
    while (handlers < kMostHandlers && impl.context.poll_one() > 0) ++handlers;
  };
  impl.context.restart();
  run();
  if (handlers == 0 && longest.count() > 0) {
    std::array<pollfd, 2> sockets{};
    sockets[0] = {.fd = impl.line->handle(), .events = POLLIN, .revents = 0};
    sockets[1] = {.fd = impl.events ? impl.events->handle() : -1, .events = POLLIN, .revents = 0};
    const timespec time{.tv_sec = longest.count() / 1'000'000,
                        .tv_nsec = longest.count() % 1'000'000 * 1000};
    ppoll(sockets.data(), sockets.size(), &time, nullptr);
    run();
  }
  std::string why = impl.line->ended();
  if (handlers == kMostHandlers) why = "it sends without end";
  if (!why.empty()) {
    throw BusError(BusFault::kBroken, "Haply's service ended the connection (" + why + ")");
  }
  why = impl.events ? impl.events->ended() : "";
  if (!why.empty()) {
    throw BusError(BusFault::kBroken, "Haply's service ended its events (" + why + ")");
  }
}

std::optional<InverseLink::Message> InverseLink::TakeMessage() { return impl_->line->Take(); }

std::optional<std::string> InverseLink::TakeEvent() {
  std::optional<Message> event = impl_->events ? impl_->events->Take() : std::nullopt;
  if (!event) return std::nullopt;
  return std::move(event->text);
}

bool InverseLink::TrySend(std::string_view text) { return impl_->line->TrySend(text); }

void InverseLink::Close(milliseconds longest) noexcept {
  try {
    impl_->line->Close(longest);
  } catch (const std::exception&) {
  }
}

InverseAnswer GetFromInverse(std::uint16_t port, const std::string& path, milliseconds longest,
                             const std::atomic<bool>& stop) {
  const Clock::time_point until = Clock::now() + longest;
  asio::io_context context{1};
  beast::tcp_stream stream(context);
  bool is_done = false;
  ErrorCode error;
  const auto end = [&](ErrorCode code, auto&&...) {
    error = code;
    is_done = true;
  };
  const auto goes_well = [&] {
    const bool is_in_time = Finish(context, is_done, until, stop);
    is_done = false;
    return is_in_time && !error;
  };
  stream.async_connect(Loopback(port), end);
  if (!goes_well()) return {};
  http::request<http::empty_body> request{http::verb::get, path, 11};
  request.set(http::field::host, "127.0.0.1:" + std::to_string(port));
  http::async_write(stream, request, end);
  if (!goes_well()) return {};
  beast::flat_buffer buffer(InverseLink::kMostBytes);
  http::response_parser<http::string_body> parser;
  parser.body_limit(InverseLink::kMostBytes);
  http::async_read(stream, buffer, parser, end);
  if (!goes_well()) return {};
  return {.status = static_cast<int>(parser.get().result_int()), .body = parser.get().body()};
}

}  // namespace palpate
