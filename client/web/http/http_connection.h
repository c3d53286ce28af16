// A browser's connection: reads requests, one at a time, and writes what Route answers.
//
// Lives as long as an operation on its socket is under way. Threads: the network thread.
#pragma once

#include <array>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/string_body.hpp>
#include <chrono>
#include <memory>
#include <optional>
#include <string>

#include "client/web/http/answer.h"
#include "client/web/http/connections.h"
#include "client/web/http/peer_stream.h"
#include "client/web/http/site.h"

namespace palpate::web {

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

}  // namespace palpate::web
