// Which sites the gateway may be used from: its own alone.
//
// Browsers say in Origin which site's page sent a request, and in Host which name they resolved. A
// foreign Origin is another site that uses a guest's cookie. A foreign Host is another site whose
// name was made to point here (DNS rebinding).
//
// Threads: any. Errors: kInvalidArgument for options under which keys would travel unprotected or
// no browser could log in.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "client/web/http/http_options.h"

namespace palpate::web {

class Origins {
 public:
  // `port`: the one that the server listens on.
  Origins(const HttpOptions& options, std::uint16_t port);

  bool AllowsOrigin(std::string_view origin) const;
  bool AllowsHost(std::string_view host) const;
  // True if browsers use https: cookies are Secure then.
  bool is_https() const { return is_https_; }
  // Before every address that browsers ask for: "/", or the path of public_url with its slashes.
  const std::string& path() const { return path_; }

 private:
  void Add(const std::string& scheme, const std::string& host, std::uint16_t port);

  bool is_https_ = false;
  std::string path_ = "/";
  std::vector<std::string> origins_, hosts_;
};

}  // namespace palpate::web
