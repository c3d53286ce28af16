// A browser's socket, with TLS or without, as one type: so that HTTP and WebSocket are compiled
// once.
//
// Asynchronous reads and writes as Boost.Asio's streams have; one of each at a time. Its time-out
// is that of boost::beast::basic_stream. Threads: the network thread.
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/beast/core/basic_stream.hpp>
#include <boost/beast/core/error.hpp>
#include <boost/beast/core/role.hpp>
#include <boost/beast/ssl/ssl_stream.hpp>
#include <cstddef>
#include <limits>
#include <memory>
#include <utility>
#include <variant>

namespace palpate::web {

// How many bytes may still be read from a socket: a rate policy of Boost.Beast. At none, reads take
// one byte a second.
class ReadBudget {
 public:
  void Set(std::size_t bytes) { left_ = bytes; }
  bool IsUsedUp() const { return left_ == 0; }

 private:
  friend class boost::beast::rate_policy_access;
  static constexpr std::size_t kNoLimit = std::numeric_limits<std::size_t>::max();

  std::size_t available_read_bytes() const { return left_; }
  std::size_t available_write_bytes() const { return kNoLimit; }
  void transfer_read_bytes(std::size_t bytes) { left_ -= bytes < left_ ? bytes : left_; }
  void transfer_write_bytes(std::size_t) {}
  void on_timer() {}

  std::size_t left_ = kNoLimit;
};

class PeerStream {
 public:
  using Tcp =
      boost::beast::basic_stream<boost::asio::ip::tcp, boost::asio::any_io_executor, ReadBudget>;
  using Tls = boost::beast::ssl_stream<Tcp>;
  using executor_type = Tcp::executor_type;

  // `tls`: null for none.
  PeerStream(boost::asio::ip::tcp::socket socket, boost::asio::ssl::context* tls)
      : stream_(std::make_unique<Variant>(std::in_place_type<Tcp>, std::move(socket))) {
    if (tls != nullptr) {
      Tcp plain = std::move(std::get<Tcp>(*stream_));
      stream_->emplace<Tls>(std::move(plain), *tls);
    }
  }

  Tcp& tcp() {
    Tls* const tls = std::get_if<Tls>(stream_.get());
    return tls != nullptr ? tls->next_layer() : std::get<Tcp>(*stream_);
  }
  executor_type get_executor() { return tcp().get_executor(); }
  void Close() { tcp().close(); }

  // `done(error)`; without TLS at once.
  template <class Done>
  void AsyncHandshake(Done done) {
    if (Tls* const tls = std::get_if<Tls>(stream_.get())) {
      tls->async_handshake(boost::asio::ssl::stream_base::server, std::move(done));
    } else {
      done(boost::beast::error_code());
    }
  }

  template <class Buffers, class Handler>
  void async_read_some(const Buffers& buffers, Handler&& handler) {
    if (Tls* const tls = std::get_if<Tls>(stream_.get())) {
      tls->async_read_some(buffers, std::forward<Handler>(handler));
    } else {
      std::get<Tcp>(*stream_).async_read_some(buffers, std::forward<Handler>(handler));
    }
  }
  template <class Buffers, class Handler>
  void async_write_some(const Buffers& buffers, Handler&& handler) {
    if (Tls* const tls = std::get_if<Tls>(stream_.get())) {
      tls->async_write_some(buffers, std::forward<Handler>(handler));
    } else {
      std::get<Tcp>(*stream_).async_write_some(buffers, std::forward<Handler>(handler));
    }
  }

 private:
  using Variant = std::variant<Tcp, Tls>;
  std::unique_ptr<Variant> stream_;  // on the heap: asio keeps references while it moves
};

// How Boost.Beast ends a WebSocket's connection: by closing it.
inline void beast_close_socket(PeerStream& stream) { stream.Close(); }

inline void teardown(boost::beast::role_type, PeerStream& stream, boost::beast::error_code& error) {
  stream.Close();
  error = {};
}

template <class Done>
void async_teardown(boost::beast::role_type, PeerStream& stream, Done&& done) {
  stream.Close();
  boost::asio::post(stream.get_executor(), [done = std::forward<Done>(done)]() mutable {
    done(boost::beast::error_code());
  });
}

}  // namespace palpate::web
