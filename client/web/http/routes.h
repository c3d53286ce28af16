// What is answered to which request. Every check of a request is here.
//
// Threads: the network thread. Errors: of the hub's functions.
#pragma once

#include <boost/beast/http/message.hpp>
#include <boost/beast/http/string_body.hpp>
#include <string>
#include <string_view>

#include "client/web/http/answer.h"
#include "client/web/http/site.h"

namespace palpate::web {

using Request = boost::beast::http::request<boost::beast::http::string_body>;

// `peer`: the socket's address, without port. An answer that `joins` has no body.
Answer Route(Site& site, const Request& request, const std::string& peer);

// The address that a request came from: the proxy's word, if there is a proxy.
std::string AddressOf(const Site& site, const Request& request, const std::string& peer);

}  // namespace palpate::web
