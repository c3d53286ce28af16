#include "client/web/http/origins.h"

#include <algorithm>
#include <cctype>

#include "common/error/error.h"

namespace palpate::web {
namespace {

std::string LowerCase(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return lower;
}

std::uint16_t DefaultPort(const std::string& scheme) { return scheme == "https" ? 443 : 80; }

struct Url {
  std::string scheme;
  HostPort address;
  std::string path;
};

// Begins and ends with a slash. It becomes a part of a header, so few characters are allowed.
std::string ParsePath(std::string path) {
  if (!path.ends_with('/')) path += '/';
  const bool has_odd = std::any_of(path.begin(), path.end(), [](unsigned char c) {
    return std::isalnum(c) == 0 && std::string_view("/-._~").find(c) == std::string_view::npos;
  });
  if (has_odd || path.find("//") != std::string::npos || path.find("/.") != std::string::npos) {
    Refuse("the path of public_url is such as /palpate/: letters, digits, and - . _ ~");
  }
  return path;
}

Url ParseUrl(std::string_view text) {
  const std::string what = "public_url is such as https://palpate.example.org";
  const std::size_t colon = text.find("://");
  if (colon == std::string_view::npos) Refuse(what);
  Url url;
  url.scheme = LowerCase(text.substr(0, colon));
  if (url.scheme != "http" && url.scheme != "https") Refuse(what);
  text.remove_prefix(colon + 3);
  const std::size_t slash = std::min(text.find('/'), text.size());
  url.path = ParsePath(std::string(text.substr(slash)));
  text = text.substr(0, slash);
  if (text.empty() || text.find_first_of("?#@ ") != std::string_view::npos) {
    Refuse(what + ", without user, ? or #");
  }
  const std::size_t last_colon = text.rfind(':');
  const bool has_port = last_colon != std::string_view::npos && !text.ends_with(']');
  url.address =
      ParseHostPort(has_port ? std::string(text)
                             : std::string(text) + ":" + std::to_string(DefaultPort(url.scheme)));
  url.address.host = LowerCase(url.address.host);
  return url;
}

}  // namespace

Origins::Origins(const HttpOptions& options, std::uint16_t port) {
  const bool has_tls = !options.certificate_file.empty();
  const bool is_loopback = options.listen.host == "localhost" || IsLoopback(options.listen);
  if (!is_loopback && !has_tls && !options.behind_proxy) {
    Refuse("listening on " + options.listen.host +
           " without TLS shows keys to the network: set certificate and key, or set behind_proxy "
           "if a proxy with TLS is in front, or listen on 127.0.0.1");
  }
  if (options.public_url.empty()) {
    if (!is_loopback || options.behind_proxy) {
      Refuse("public_url is missing: other sites are told apart by it");
    }
    is_https_ = has_tls;
    for (const char* host : {"localhost", "127.0.0.1", "::1"}) {
      Add(has_tls ? "https" : "http", host, port);
    }
    return;
  }
  const Url url = ParseUrl(options.public_url);
  is_https_ = url.scheme == "https";
  const bool is_local = url.address.host == "localhost" || IsLoopback(url.address);
  if (is_https_ && !has_tls && !options.behind_proxy) {
    Refuse("public_url is https: set certificate and key, or behind_proxy");
  }
  if (!is_https_ && (has_tls || !is_local)) Refuse("public_url must begin with https://");
  Add(url.scheme, url.address.host, url.address.port);
  path_ = url.path;
}

bool Origins::AllowsOrigin(std::string_view origin) const {
  return std::find(origins_.begin(), origins_.end(), LowerCase(origin)) != origins_.end();
}

bool Origins::AllowsHost(std::string_view host) const {
  return std::find(hosts_.begin(), hosts_.end(), LowerCase(host)) != hosts_.end();
}

// Browsers leave out the scheme's own port.
void Origins::Add(const std::string& scheme, const std::string& host, std::uint16_t port) {
  const std::string with_port = HostPort{host, port}.ToString();
  hosts_.push_back(with_port);
  if (port == DefaultPort(scheme)) {
    hosts_.push_back(with_port.substr(0, with_port.rfind(':')));
  }
  origins_.push_back(scheme + "://" + hosts_.back());
}

}  // namespace palpate::web
