// An answer to a request, before it is written.
//
// Threads: plain values.
#pragma once

#include <boost/beast/http/field.hpp>
#include <boost/beast/http/fields.hpp>
#include <boost/beast/http/status.hpp>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "client/web/logins/sessions.h"
#include "client/web/volume/blob.h"

namespace palpate::web {

using Body = std::shared_ptr<const std::string>;

struct Answer {
  using Field = boost::beast::http::field;

  boost::beast::http::status status = boost::beast::http::status::ok;
  std::string_view content_type = "text/plain; charset=utf-8";
  Body body;  // null: none
  std::vector<std::pair<Field, std::string>> fields{};
  SessionPtr session{};  // of who asked; null: nobody who has logged in
  bool joins = false;    // the request becomes a WebSocket
};

// One line of text.
Answer TextAnswer(boost::beast::http::status status, std::string line);

// What every answer has: no page of another site may frame, script or read anything of this one.
void AddProtection(boost::beast::http::fields& fields);

// The best encoding that an Accept-Encoding allows: zstd, else gzip, else none.
Encoding ChooseEncoding(std::string_view accept);

// The bytes of answers that are being written. Slow readers hold what was superseded long ago; this
// bounds it. One network may hold as much as it leaves to others, and one user as much as they
// leave to others of their network.
class HeldBodies {
 public:
  // Bodies up to here are always held: answers to logins, most groups of a volume. Of the 1024
  // connections together at most 64 MiB.
  static constexpr std::size_t kSmallBytes = std::size_t{64} << 10;
  struct Holder {
    std::string network, user;
  };

  explicit HeldBodies(std::size_t most_bytes) : most_bytes_(most_bytes) {}

  // False: too much is held already. A body that several hold counts once.
  bool Hold(const Body& body, const Holder& holder);
  void Release(const Body& body, const Holder& holder);
  std::size_t bytes() const { return all_.bytes; }
  // The largest body that `holder` may hold.
  std::size_t Left(const Holder& holder) const;

 private:
  struct Bodies {
    std::unordered_map<const std::string*, int> holders;
    std::size_t bytes = 0;
  };

  const std::size_t most_bytes_;
  Bodies all_;
  std::map<std::string, Bodies, std::less<>> networks_, users_;
};

}  // namespace palpate::web
