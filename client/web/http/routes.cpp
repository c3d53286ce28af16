#include "client/web/http/routes.h"

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <boost/system/error_code.hpp>
#include <cctype>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "client/web/http/connections.h"
#include "client/web/http/guest.h"

namespace palpate::web {
namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;

constexpr std::string_view kCookie = "palpate_session";
constexpr std::string_view kBinary = "application/octet-stream";
constexpr std::size_t kMostBlobs = 32;  // of one request
// Of several blobs together. The page asks for 16 groups of at most 128 KiB.
constexpr std::size_t kMostBundleBytes = std::size_t{8} << 20;

std::string_view View(boost::beast::string_view text) { return {text.data(), text.size()}; }

// Calls `use(item)` with the items between separators until it returns true.
template <class Use>
void ForEach(std::string_view items, char separator, const Use& use) {
  while (!items.empty()) {
    const std::size_t end = std::min(items.find(separator), items.size());
    std::string_view item = items.substr(0, end);
    while (item.starts_with(' ')) item.remove_prefix(1);
    while (item.ends_with(' ')) item.remove_suffix(1);
    if (use(item)) return;
    items.remove_prefix(std::min(end + 1, items.size()));
  }
}

// One request, with what the checks need of it.
class Router {
 public:
  Router(Site& site, const Request& request, const std::string& peer)
      : site_(site),
        request_(request),
        address_(AddressOf(site, request, peer)),
        path_(PathOf(site, View(request.target()))),
        now_(std::chrono::steady_clock::now()) {
    FindSession();
  }

  Answer Run() {
    Answer answer = Find();
    if (answer.session == nullptr) answer.session = session_;
    return answer;
  }

 private:
  // Below the path of public_url. Some proxies take that off, others pass it on.
  static std::string_view PathOf(const Site& site, std::string_view target) {
    std::string_view path = target.substr(0, target.find('?'));
    const std::string& base = site.origins.path();
    if (path.starts_with(base)) path.remove_prefix(base.size() - 1);
    return path;
  }

  Answer Find() {
    // Without a look at the name: what asks is a supervisor, and it learns nothing.
    if (path_ == "/health") return IsGet() ? Health() : WrongMethod("GET");
    if (request_.count(http::field::host) != 1 || !site_.origins.AllowsHost(Field("Host"))) {
      return Refuse(http::status::misdirected_request, "host",
                    "this is not the name of this site: see public_url");
    }
    if (path_ == "/login") return IsPost() ? LogIn() : WrongMethod("POST");
    if (path_ == "/logout") return IsPost() ? LogOut() : WrongMethod("POST");
    if (!IsGet()) return WrongMethod("GET");
    if (path_ == "/stream") return Join();
    if (const std::string& base = site_.origins.path(); base == std::string(path_) + '/') {
      return SendOn(base);
    }
    constexpr std::string_view kVolume = "/volume/";
    if (path_.starts_with(kVolume)) return VolumeBlobs(path_.substr(kVolume.size()));
    return File();
  }

  bool IsGet() const { return request_.method() == http::verb::get; }
  bool IsPost() const { return request_.method() == http::verb::post; }
  std::string_view Field(const char* name) const { return View(request_[name]); }

  Answer Refuse(http::status status, std::string_view kind, std::string why) {
    site_.log.Refused(kind, address_ + ": " + why, now_);
    return TextAnswer(status, std::move(why));
  }
  Answer WrongMethod(const char* right) {
    Answer answer = Refuse(http::status::method_not_allowed, "method", "wrong method");
    answer.fields.emplace_back(http::field::allow, right);
    return answer;
  }

  // A browser may have several cookies of this name, for another site can add some. More than a few
  // are an attack.
  void FindSession() {
    int left = 4;
    ForEach(Field("Cookie"), ';', [&](std::string_view cookie) {
      const std::size_t equals = cookie.find('=');
      if (cookie.substr(0, equals) != kCookie || equals == std::string_view::npos) return false;
      cookie_ = cookie.substr(equals + 1);
      session_ = site_.access.Find(cookie_, now_);
      return session_ != nullptr || --left == 0;
    });
  }

  bool IsFromOwnPage() const {
    return request_.count(http::field::origin) == 1 && site_.origins.AllowsOrigin(Field("Origin"));
  }
  Answer WrongOrigin() {
    return Refuse(http::status::forbidden, "origin", "only this site's own page may do this");
  }
  Answer NoLogin() { return Refuse(http::status::unauthorized, "login", "log in first"); }

  // The page's links are relative: without the slash at its end they would lead beside the page.
  static Answer SendOn(const std::string& base) {
    Answer answer = TextAnswer(http::status::permanent_redirect, base);
    answer.fields.emplace_back(http::field::location, base);
    return answer;
  }

  Answer Health() {
    const std::string problem = site_.hub.health ? site_.hub.health() : std::string();
    return problem.empty() ? TextAnswer(http::status::ok, "ok")
                           : TextAnswer(http::status::service_unavailable, problem);
  }

  std::string SessionCookie(const std::string& value, bool is_over) const {
    std::string cookie = std::string(kCookie) + "=" + value +
                         "; HttpOnly; SameSite=Strict; Path=" + site_.origins.path();
    if (site_.origins.is_https()) cookie += "; Secure";
    return is_over ? cookie + "; Max-Age=0" : cookie;
  }

  Answer LogIn() {
    if (!IsFromOwnPage()) return WrongOrigin();
    const std::string_view type = Field("Content-Type");
    if (type.substr(0, type.find(';')) != "application/json") {
      return Refuse(http::status::unsupported_media_type, "malformed", "the body must be JSON");
    }
    const std::optional<LoginRequest> login = ParseLogin(request_.body());
    if (!login) {
      return Refuse(http::status::bad_request, "malformed", "the body must have room or token");
    }
    const Access::Login result =
        site_.access.LogIn(login->room ? Access::Secret::kRoomKey : Access::Secret::kToken,
                           login->room ? *login->room : *login->token, NetworkOf(address_), now_);
    switch (result.result) {
      case Access::Result::kWrong:
        return Refuse(http::status::forbidden, "key", "wrong key");
      case Access::Result::kTooManyAttempts:
        return Refuse(http::status::too_many_requests, "attempts",
                      "wrong key, after too many from this address within a minute");
      case Access::Result::kWelcome:
        break;
    }
    const std::string note = address_ + ": " + result.session->user + " logged in";
    login->token ? site_.log.Always(note) : site_.log.Note("login", note, now_);
    Answer answer;
    answer.content_type = "application/json";
    answer.body = std::make_shared<const std::string>(nlohmann::json{
        {"user", result.session->user},
        {"may_steer", result.session->may_steer}}.dump());
    answer.fields = {{http::field::cache_control, "no-store"},
                     {http::field::set_cookie, SessionCookie(result.cookie, false)}};
    answer.session = result.session;
    return answer;
  }

  Answer LogOut() {
    if (!IsFromOwnPage()) return WrongOrigin();
    site_.access.LogOut(cookie_);
    Answer answer;
    answer.status = http::status::no_content;
    answer.fields = {{http::field::set_cookie, SessionCookie("", true)}};
    return answer;
  }

  Answer Join() {
    if (!IsFromOwnPage()) return WrongOrigin();
    if (session_ == nullptr) return NoLogin();
    if (!boost::beast::websocket::is_upgrade(request_)) {
      return Refuse(http::status::upgrade_required, "malformed", "this is a WebSocket");
    }
    if (Guest::IsFull(site_) && Guest::WhoGivesWayTo(*session_, site_) == nullptr) {
      return Refuse(http::status::service_unavailable, "full", "there are too many guests");
    }
    Answer answer;
    answer.joins = true;
    return answer;
  }

  // A blob, or several with commas between their names: a volume has thousands, and each request
  // costs a browser milliseconds.
  Answer VolumeBlobs(std::string_view names) {
    const bool has_site = request_.find("Sec-Fetch-Site") != request_.end();
    if (has_site && Field("Sec-Fetch-Site") != "same-origin") return WrongOrigin();
    if (session_ == nullptr) return NoLogin();
    std::vector<BlobPtr> blobs;
    bool are_names = true;
    ForEach(names, ',', [&](std::string_view name) {
      are_names = IsBlobName(name) && blobs.size() < kMostBlobs &&
                  std::none_of(blobs.begin(), blobs.end(),
                               [&](const BlobPtr& blob) { return blob->name() == name; });
      if (are_names) blobs.push_back(site_.hub.find_blob(name));
      return !are_names || blobs.back() == nullptr;
    });
    if (!are_names || blobs.empty() || blobs.back() == nullptr) {
      // Not logged: pages ask so whenever the volume has changed meanwhile.
      return TextAnswer(are_names && !blobs.empty() ? http::status::gone : http::status::not_found,
                        "ask for what the newest manifest names");
    }
    Answer answer = blobs.size() == 1 ? Encoded(*blobs.front()) : Bundle(blobs);
    if (answer.status != http::status::ok) return answer;
    answer.fields.emplace_back(http::field::cache_control, "private, max-age=31536000, immutable");
    answer.fields.emplace_back(http::field::vary, "Cookie, Accept-Encoding");
    return answer;
  }

  // Frames of zstd that follow each other are one stream. A blob may not keep what it compressed:
  // each is asked once.
  Answer Bundle(const std::vector<BlobPtr>& blobs) {
    const Answer refusal = TextAnswer(http::status::not_acceptable, "ask for one blob at a time");
    if (ChooseEncoding(Field("Accept-Encoding")) != Encoding::kZstd) return refusal;
    const std::size_t most =
        std::min(kMostBundleBytes, site_.bodies.Left({session_->network, session_->user}));
    std::size_t bytes = 0;
    std::vector<Body> frames;
    for (const BlobPtr& blob : blobs) {
      if (blob->content_type() != kBinary) return refusal;
      bytes += frames.emplace_back(blob->Encoded(Encoding::kZstd))->size();
      if (bytes > most) return refusal;
    }
    std::string joined;
    joined.reserve(bytes);
    for (const Body& frame : frames) joined += *frame;
    Answer answer;
    answer.content_type = kBinary;
    answer.body = std::make_shared<const std::string>(std::move(joined));
    answer.fields = {{http::field::content_encoding, "zstd"}};
    return answer;
  }

  static bool IsBlobName(std::string_view name) {
    return name.size() == 32 && std::all_of(name.begin(), name.end(), [](char c) {
             return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
           });
  }

  Answer Encoded(const Blob& blob) {
    const Encoding encoding = ChooseEncoding(Field("Accept-Encoding"));
    Answer answer;
    answer.content_type = blob.content_type();
    answer.body = blob.Encoded(encoding);
    if (encoding != Encoding::kIdentity) {
      answer.fields.emplace_back(http::field::content_encoding,
                                 encoding == Encoding::kZstd ? "zstd" : "gzip");
    }
    return answer;
  }

  Answer File() {
    const StaticFile* const file = site_.files.Find(path_);
    if (file == nullptr) return TextAnswer(http::status::not_found, "there is no such page");
    Answer answer;
    if (Field("If-None-Match") == file->etag) {
      answer.status = http::status::not_modified;
    } else {
      answer = Encoded(*file->content);
    }
    answer.fields.emplace_back(http::field::etag, file->etag);
    answer.fields.emplace_back(http::field::cache_control, "no-cache");
    answer.fields.emplace_back(http::field::vary, "Accept-Encoding");
    return answer;
  }

  Site& site_;
  const Request& request_;
  const std::string address_;
  const std::string_view path_;
  const Time now_;
  std::string_view cookie_;
  SessionPtr session_;
};

}  // namespace

Answer Route(Site& site, const Request& request, const std::string& peer) {
  return Router(site, request, peer).Run();
}

std::string AddressOf(const Site& site, const Request& request, const std::string& peer) {
  if (!site.options.behind_proxy) return peer;
  // The last entry of the last field: the ones before come from the browser.
  std::string_view last;
  for (const auto& field : request) {
    if (!boost::beast::iequals(field.name_string(), "X-Forwarded-For")) {
      continue;
    }
    ForEach(View(field.value()), ',', [&](std::string_view entry) {
      last = entry;
      return false;
    });
  }
  boost::system::error_code problem;
  const auto address = asio::ip::make_address(std::string(last), problem);
  return problem ? peer : address.to_string();
}

}  // namespace palpate::web
