// The gateway's requests and answers, and requests that must not be answered.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <string>
#include <vector>

#include "client/web/http/answer.h"
#include "client/web/http/origins.h"
#include "common/error/error.h"
#include "tests/support/certificates.h"
#include "tests/support/refusal.h"
#include "tests/support/web_rig.h"

namespace palpate::test {
namespace {

constexpr auto kGet = http::verb::get;
constexpr auto kPost = http::verb::post;

TEST(WebHttp, ThePageNeedsNoLogin) {
  WebRig rig;
  Browser browser(rig);
  const WebResponse page = browser.Get("/");
  EXPECT_EQ(page.result_int(), 200u);
  EXPECT_EQ(page.body(), browser.Get("/index.html?view=1").body());
  EXPECT_EQ(page["Content-Type"], "text/html; charset=utf-8");
  EXPECT_EQ(page["Cache-Control"], "no-cache");
  EXPECT_EQ(browser.Get("/app.js")["Content-Type"], "text/javascript; charset=utf-8");

  const WebResponse same = browser.Get("/", {{"If-None-Match", std::string(page["ETag"])}});
  EXPECT_EQ(same.result_int(), 304u);
  EXPECT_EQ(same.body(), "");
  for (const std::string encoding : {"gzip", "zstd"}) {
    const WebResponse coded = browser.Get("/app.js", {{"Accept-Encoding", encoding}});
    EXPECT_EQ(coded["Content-Encoding"], encoding);
    EXPECT_LT(coded.body().size(), 500u);
  }
  EXPECT_EQ(browser.Get("/app.js")["Content-Encoding"], "");
}

TEST(WebHttp, EncodingsAreChosenAsAccepted) {
  using web::ChooseEncoding;
  using web::Encoding;
  EXPECT_EQ(ChooseEncoding("gzip, deflate, br, zstd"), Encoding::kZstd);
  EXPECT_EQ(ChooseEncoding("gzip,deflate"), Encoding::kGzip);
  EXPECT_EQ(ChooseEncoding("zstd;q=0, gzip;q=0.5"), Encoding::kGzip);
  EXPECT_EQ(ChooseEncoding("zstd ; q=0.000,gzip;q=0"), Encoding::kIdentity);
  EXPECT_EQ(ChooseEncoding(""), Encoding::kIdentity);
  EXPECT_EQ(ChooseEncoding(",,;=;q="), Encoding::kIdentity);
  EXPECT_EQ(ChooseEncoding("x-gzip, gzipped"), Encoding::kIdentity);
}

TEST(WebHttp, NoPathReachesAnotherFile) {
  WebRig rig;
  Browser browser(rig);
  const std::string outside = rig.outside();
  for (const std::string& path :
       {"/.." + outside, "/../../../../../.." + outside, "/%2e%2e/%2e%2e/%2e%2e" + outside,
        "/..%2f..%2f..%2f.." + outside, "/..%252f..%252f.." + outside, "//" + outside, outside,
        "/%00" + outside, "/index.html/../../" + outside, "/..\\..\\.." + outside,
        std::string("/app.js%00.html"), "/volume/../../.." + outside,
        "/volume/" + std::string(30, 'a') + "..", "file://" + outside, "http://x" + outside,
        std::string("/./app.js"), std::string("/app.js/")}) {
    browser.LogIn();
    const WebResponse answer = browser.Get(path);
    EXPECT_GE(answer.result_int(), 400u) << path;
    EXPECT_EQ(answer.body().find("secret"), std::string::npos) << path;
    browser.Connect();
  }
}

TEST(WebHttp, RoomKeyOrTokenLogsIn) {
  WebRig rig;
  Browser guest(rig);
  const WebResponse welcome = guest.LogIn();
  EXPECT_EQ(welcome.result_int(), 200u);
  EXPECT_EQ(welcome.body(), R"({"may_steer":[],"user":"guest-1"})");
  // Each attribute, but Secure, for this is not https.
  const std::string cookie(welcome["Set-Cookie"]);
  EXPECT_EQ(cookie, guest.cookie + "; HttpOnly; SameSite=Strict; Path=/");
  EXPECT_EQ(guest.cookie.size(), std::string("palpate_session=").size() + 32);
  EXPECT_EQ(guest.Get("/volume/" + kBlobName).result_int(), 200u);

  Browser lecturer(rig);
  EXPECT_EQ(lecturer.LogInAsLecturer().body(),
            R"({"may_steer":["isovalue","pop_force_n"],"user":"lecturer"})");
  // Neither secret is in the log.
  for (const std::string& secret : {kRoomKey, kToken, guest.cookie.substr(16)}) {
    EXPECT_EQ(rig.log().find(secret), std::string::npos);
  }
}

TEST(WebHttp, LoginsByTokenAreAlwaysLogged) {
  WebRig rig;
  Browser browser(rig);
  for (int n = 0; n < 5; ++n) {
    browser.LogIn();
    browser.LogInAsLecturer();
  }
  const std::string log = rig.log(), line = "127.0.0.1: lecturer logged in\n";
  int lines = 0;
  for (std::size_t at = log.find(line); at != log.npos; at = log.find(line, at + 1)) ++lines;
  EXPECT_EQ(lines, 5) << log;
}

TEST(WebHttp, WrongKeysAreFew) {
  WebRig rig;
  Browser browser(rig);
  for (int n = 0; n < 10; ++n) {
    EXPECT_EQ(browser.LogIn(R"({"room":"another key of a room"})").result_int(), 403u);
  }
  EXPECT_EQ(browser.LogIn(R"({"token":"another"})").result_int(), 429u);
  EXPECT_EQ(browser.LogIn(R"({"room":"another key of a room"})").result_int(), 429u);
  EXPECT_EQ(browser.cookie, "");
  EXPECT_EQ(browser.LogIn().result_int(), 200u);
  EXPECT_EQ(rig.refused("key"), 10);
  EXPECT_EQ(rig.refused("attempts"), 2);
  const std::string log = rig.log();
  EXPECT_LT(std::count(log.begin(), log.end(), '\n'), 12) << log;
}

TEST(WebHttp, BehindAProxyTheLastAddressCounts) {
  web::HttpOptions options;
  options.behind_proxy = true;
  options.public_url = "https://palpate.example.org";
  WebRig rig(options);
  const auto log_in = [&](const std::string& forwarded, const std::string& body) {
    Browser browser(rig);
    return browser
        .LogIn(body, {{"X-Forwarded-For", forwarded},
                      {"Host", "palpate.example.org"},
                      {"Origin", "https://palpate.example.org"}})
        .result_int();
  };
  for (int n = 0; n < 10; ++n) {
    // What the browser claims is no help.
    EXPECT_EQ(log_in(std::to_string(n) + ".1.1.1, 10.0.0.7", R"({"room":"x"})"), 403u);
  }
  EXPECT_EQ(log_in("9.9.9.9, 10.0.0.7", R"({"room":"x"})"), 429u);
  EXPECT_EQ(log_in("10.0.0.7, 10.0.0.8", R"({"room":"x"})"), 403u);
  // Addresses of one IPv6 network are one guest's.
  for (int n = 0; n < 10; ++n) {
    EXPECT_EQ(log_in("2001:db8:0:1::" + std::to_string(n), R"({"room":"x"})"), 403u);
  }
  EXPECT_EQ(log_in("2001:db8:0:1:7::", R"({"room":"x"})"), 429u);
  EXPECT_EQ(log_in("2001:db8:0:2::", R"({"room":"x"})"), 403u);
  EXPECT_EQ(log_in("not an address", kRoomLogin), 200u);
}

TEST(WebHttp, WithoutAProxyForwardedAddressesAreIgnored) {
  WebRig rig;
  Browser browser(rig);
  for (int n = 0; n < 12; ++n) {
    const WebResponse answer =
        browser.LogIn(R"({"room":"x"})", {{"X-Forwarded-For", "10.0.0." + std::to_string(n)}});
    EXPECT_EQ(answer.result_int(), n < 10 ? 403u : 429u);
  }
}

TEST(WebHttp, LoginIsJsonOfTheContract) {
  WebRig rig;
  Browser browser(rig);
  const auto status = [&](const std::string& body, const Fields& fields = {}) {
    return browser.LogIn(body, fields).result_int();
  };
  for (const std::string& bad :
       {std::string("{"), std::string("[]"), std::string("null"), std::string("{}"),
        std::string(R"({"room":7})"), std::string(R"({"room":null,"token":null})"),
        R"({"room":")" + kRoomKey + R"(","token":")" + kToken + "\"}", std::string("\xff\xfe"),
        std::string(4000, '['), std::string("room=" + kRoomKey)}) {
    EXPECT_EQ(status(bad), 400u) << bad;
  }
  // A form of another site can send these types without asking.
  for (const std::string type : {"", "text/plain", "application/x-www-form-urlencoded",
                                 "multipart/form-data", "application/jsonp"}) {
    EXPECT_EQ(status(kRoomLogin, {{"Content-Type", type}}), 415u) << type;
  }
  EXPECT_EQ(status(kRoomLogin, {{"Content-Type", "application/json; charset=utf-8"}}), 200u);
}

TEST(WebHttp, OtherSitesMayNothing) {
  WebRig rig;
  Browser browser(rig);
  browser.LogIn();
  const std::string port = std::to_string(rig.port());
  for (const std::string& origin :
       {std::string(), std::string("null"), std::string("https://evil.example"),
        "https://127.0.0.1:" + port, std::string("http://127.0.0.1"),
        "http://127.0.0.1:" + port + "0", "http://127.0.0.1:" + port + ".evil.example",
        "http://evil.example/" + rig.origin(), rig.origin() + "/",
        rig.origin() + " http://evil.example"}) {
    const Fields fields = {{"Origin", origin}};
    EXPECT_EQ(browser.Send(kPost, "/login", kRoomLogin, fields).result_int(), 403u) << origin;
    EXPECT_EQ(browser.Send(kPost, "/logout", "", fields).result_int(), 403u) << origin;
    EXPECT_EQ(browser.Get("/stream", fields).result_int(), 403u) << origin;
  }
  // Still logged in.
  EXPECT_EQ(browser.Get("/volume/" + kBlobName).result_int(), 200u);
  for (const std::string site : {"cross-site", "same-site", "none"}) {
    EXPECT_EQ(browser.Get("/volume/" + kBlobName, {{"Sec-Fetch-Site", site}}).result_int(), 403u);
  }
  EXPECT_EQ(browser.Get("/volume/" + kBlobName, {{"Sec-Fetch-Site", "same-origin"}}).result_int(),
            200u);
  EXPECT_GT(rig.refused("origin"), 0);
}

TEST(WebHttp, OtherNamesAreNotServed) {
  WebRig rig;
  Browser browser(rig);
  const std::string port = std::to_string(rig.port());
  browser.LogIn();
  for (const std::string& host : {std::string("evil.example"), "evil.example:" + port,
                                  std::string("127.0.0.1"), "127.0.0.2:" + port, std::string()}) {
    for (const std::string& path :
         {std::string("/"), "/volume/" + kBlobName, std::string("/stream")}) {
      EXPECT_EQ(browser.Get(path, {{"Host", host}}).result_int(), 421u) << host << path;
    }
    EXPECT_EQ(browser.Send(kPost, "/login", kRoomLogin, {{"Host", host}}).result_int(), 421u);
  }
  for (const std::string& host : {"localhost:" + port, "LocalHost:" + port, "[::1]:" + port}) {
    EXPECT_EQ(browser.Get("/", {{"Host", host}}).result_int(), 200u) << host;
  }
  browser.SendBytes("GET / HTTP/1.1\r\nHost: " + rig.host() + "\r\nHost: evil.example\r\n\r\n");
  EXPECT_EQ(browser.Receive().result_int(), 421u);
}

TEST(WebHttp, SeveralBlobsComeInOneAnswer) {
  WebRig rig;
  Browser browser(rig);
  const std::string both = "/volume/" + kBlobName + "," + kBigBlobName;
  const Fields zstd = {{"Accept-Encoding", "zstd"}};
  EXPECT_EQ(browser.Get(both, zstd).result_int(), 401u);
  browser.LogIn();
  const WebResponse answer = browser.Get(both, zstd);
  EXPECT_EQ(answer.result_int(), 200u);
  EXPECT_EQ(answer["Content-Encoding"], "zstd");
  EXPECT_EQ(answer.body(), browser.Get("/volume/" + kBlobName, zstd).body() +
                               browser.Get("/volume/" + kBigBlobName, zstd).body());
  // Browsers do not read several streams of gzip.
  EXPECT_EQ(browser.Get(both, {{"Accept-Encoding", "gzip"}}).result_int(), 406u);
  EXPECT_EQ(browser.Get(both + "," + std::string(32, 'b'), zstd).result_int(), 410u);
  EXPECT_EQ(browser.Get(both + ",a", zstd).result_int(), 404u);
  EXPECT_EQ(browser.Get("/volume/" + kBlobName + "," + kBlobName, zstd).result_int(), 404u);
  EXPECT_EQ(browser.Get("/volume/" + kBlobName + "," + kManifestName, zstd).result_int(), 406u);
  EXPECT_EQ(browser.Get("/volume/" + kManifestName, zstd).result_int(), 200u);
}

TEST(WebHttp, BundlesAreBounded) {
  WebRig rig;
  Browser browser(rig);
  browser.LogIn();
  const auto get = [](Browser& from, int first, int count) {
    std::string path = "/volume/" + NoiseName(first);
    for (int n = first + 1; n < first + count; ++n) path += "," + NoiseName(n);
    return from.Get(path, {{"Accept-Encoding", "zstd"}}).result_int();
  };
  EXPECT_EQ(get(browser, 0, 2), 200u);
  EXPECT_EQ(get(browser, 0, 3), 406u);

  web::HttpOptions options;
  options.max_held_bytes = kNoiseBytes * 3 / 2;
  WebRig small(options);
  Browser there(small);
  there.LogIn();
  EXPECT_EQ(get(there, 0, 2), 406u);
  EXPECT_EQ(get(there, 0, 1), 200u);
}

TEST(WebHttp, UpToThirtyTwoBlobsComeTogether) {
  WebRig rig;
  rig.OnNetwork([&] {
    rig.hub().find_blob = [](std::string_view name) {
      return std::make_shared<const web::Blob>(std::string(name), "application/octet-stream",
                                               [] { return std::string(1000, 'v'); });
    };
  });
  Browser browser(rig);
  browser.LogIn();
  std::string path = "/volume/" + NoiseName(0);
  for (int n = 1; n < 32; ++n) path += "," + NoiseName(n);
  EXPECT_EQ(browser.Get(path, {{"Accept-Encoding", "zstd"}}).result_int(), 200u);
  path += "," + NoiseName(32);
  EXPECT_EQ(browser.Get(path, {{"Accept-Encoding", "zstd"}}).result_int(), 404u);
}

TEST(WebHttp, TheVolumeIsForThoseWhoLoggedIn) {
  WebRig rig;
  Browser browser(rig);
  const std::string path = "/volume/" + kBlobName;
  for (const std::string& cookie :
       {std::string(), std::string("palpate_session="), "palpate_session=" + std::string(32, '0'),
        std::string("palpate_session")}) {
    browser.cookie = cookie;
    EXPECT_EQ(browser.Get(path).result_int(), 401u) << cookie;
    EXPECT_EQ(browser.Get("/stream").result_int(), 401u) << cookie;
  }
  browser.LogIn();
  const std::string session = browser.cookie;
  const WebResponse blob = browser.Get(path);
  EXPECT_EQ(blob.body(), std::string(32768, 'v'));
  EXPECT_EQ(blob["Cache-Control"], "private, max-age=31536000, immutable");
  EXPECT_EQ(blob["Vary"], "Cookie, Accept-Encoding");
  EXPECT_EQ(browser.Get(path, {{"Accept-Encoding", "gzip, zstd"}})["Content-Encoding"], "zstd");
  EXPECT_EQ(browser.Get("/volume/" + std::string(32, 'b')).result_int(), 410u);
  for (const std::string name : {"", "a", "AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA", "../app.js"}) {
    EXPECT_EQ(browser.Get("/volume/" + name).result_int(), 404u) << name;
  }
  // Beside cookies of others, too.
  browser.cookie = "a=b; palpate_session=" + std::string(32, '0') + "; " + session;
  EXPECT_EQ(browser.Get(path).result_int(), 200u);

  browser.cookie = session;
  const WebResponse bye = browser.Send(kPost, "/logout");
  EXPECT_EQ(bye.result_int(), 204u);
  EXPECT_NE(bye["Set-Cookie"].find("Max-Age=0"), std::string::npos);
  browser.cookie = session;
  EXPECT_EQ(browser.Get(path).result_int(), 401u);
}

TEST(WebHttp, SessionsEnd) {
  web::AccessOptions access = WebRig::DefaultAccess();
  access.session_life = std::chrono::seconds(1);
  web::HttpOptions options;
  options.timeouts.sweep = std::chrono::milliseconds(10);
  WebRig rig(options, access);
  TestGuest guest(rig);
  EXPECT_NE(guest.ReadUntil("hello"), "");
  EXPECT_EQ(guest.CloseCode(), websocket::close_code::policy_error);
  Browser browser(rig);
  browser.LogIn();
  EXPECT_TRUE(Eventually([&] { return browser.Get("/volume/" + kBlobName).result_int() == 401u; }));
}

TEST(WebHttp, EveryAnswerIsProtected) {
  WebRig rig;
  Browser browser(rig);
  const auto expect_protected = [&](const WebResponse& answer) {
    ASSERT_NE(answer.result_int(), 0u);
    SCOPED_TRACE(answer.result_int());
    const std::string policy(answer["Content-Security-Policy"]);
    for (const std::string part : {"default-src 'none'", "script-src 'self'", "base-uri 'none'",
                                   "form-action 'none'", "frame-ancestors 'none'"}) {
      EXPECT_NE(policy.find(part), std::string::npos);
    }
    EXPECT_EQ(policy.find("unsafe"), std::string::npos);
    EXPECT_EQ(answer["X-Content-Type-Options"], "nosniff");
    EXPECT_EQ(answer["Referrer-Policy"], "no-referrer");
    EXPECT_EQ(answer["Cross-Origin-Resource-Policy"], "same-origin");
    EXPECT_EQ(answer["Cross-Origin-Opener-Policy"], "same-origin");
    EXPECT_EQ(answer["Access-Control-Allow-Origin"], "");
  };
  expect_protected(browser.Get("/"));
  expect_protected(browser.Get("/nothing"));
  expect_protected(browser.Get("/health"));
  expect_protected(browser.Get("/", {{"Host", "evil.example"}}));
  expect_protected(browser.Get("/volume/" + kBlobName));
  expect_protected(browser.Send(http::verb::options, "/login"));
  expect_protected(browser.LogIn());
  expect_protected(browser.Get("/volume/" + kBlobName));
  expect_protected(browser.Send(kPost, "/logout"));
  browser.SendBytes("nonsense\r\n\r\n");
  expect_protected(browser.Receive());
  TestGuest guest(rig);
  EXPECT_EQ(guest.answer["X-Content-Type-Options"], "nosniff");
  EXPECT_NE(guest.answer["Content-Security-Policy"], "");
}

TEST(WebHttp, MethodsAreThoseOfTheContract) {
  WebRig rig;
  Browser browser(rig);
  for (const auto method : {http::verb::put, http::verb::delete_, http::verb::options,
                            http::verb::trace, http::verb::connect, http::verb::patch}) {
    for (const std::string path : {"/", "/login", "/volume/a", "/stream", "/health"}) {
      EXPECT_EQ(browser.Send(method, path).result_int(), 405u) << method << path;
    }
  }
  EXPECT_EQ(browser.Get("/login").result_int(), 405u);
  EXPECT_EQ(browser.Send(kPost, "/").result_int(), 405u);
}

TEST(WebHttp, HealthNeedsNoLogin) {
  WebRig rig;
  Browser browser(rig);
  EXPECT_EQ(browser.Get("/health", {{"Host", "10.0.0.1"}}).body(), "ok\n");
  rig.OnNetwork([&] { rig.hub().health = [] { return std::string("palpated is lost"); }; });
  EXPECT_EQ(browser.Send(kGet, "/health").result_int(), 503u);
}

TEST(WebHttp, KeysDoNotTravelUnprotected) {
  const auto refuses = [](const std::string& listen, const std::string& url, bool tls, bool proxy) {
    web::HttpOptions options;
    options.listen = {listen, 7480};
    options.public_url = url;
    if (tls) options.certificate_file = options.key_file = "some.pem";
    options.behind_proxy = proxy;
    return testing::Refusal([&] { web::Origins(options, 7480); }) == ErrorKind::kInvalidArgument;
  };
  EXPECT_FALSE(refuses("127.0.0.1", "", false, false));
  EXPECT_FALSE(refuses("::1", "", false, false));
  EXPECT_FALSE(refuses("0.0.0.0", "https://palpate.example.org", true, false));
  EXPECT_FALSE(refuses("0.0.0.0", "https://palpate.example.org:8443/", false, true));
  EXPECT_TRUE(refuses("0.0.0.0", "https://palpate.example.org", false, false));
  EXPECT_TRUE(refuses("0.0.0.0", "http://palpate.example.org", false, true));
  EXPECT_TRUE(refuses("0.0.0.0", "", true, false));
  EXPECT_TRUE(refuses("127.0.0.1", "", false, true));
  EXPECT_TRUE(refuses("127.0.0.1", "https://palpate.example.org", false, false));
  for (const std::string bad : {"palpate.example.org", "ftp://a", "https://", "https:///path",
                                "https://user@a", "https://a:port", "https://a?b", "https://a/b?c",
                                "https://a/b#c", "https://a/b;c", "https://a//b", "https://a/.."}) {
    EXPECT_TRUE(refuses("127.0.0.1", bad, true, false)) << bad;
  }
}

// Behind a proxy that passes the path on, and behind one that takes it off.
TEST(WebHttp, APathOfPublicUrlIsBeforeEveryAddress) {
  web::HttpOptions options;
  options.behind_proxy = true;
  options.public_url = "https://lab.example/at/palpate/";
  WebRig rig(options);
  const Fields own = {{"Host", "lab.example"}, {"Origin", "https://lab.example"}};
  for (const std::string base : {"/at/palpate", ""}) {
    Browser browser(rig);
    const std::string set_cookie(
        browser.Send(kPost, base + "/login", kRoomLogin, own)["Set-Cookie"]);
    EXPECT_NE(set_cookie.find("; Path=/at/palpate/;"), std::string::npos) << set_cookie;
    browser.cookie = set_cookie.substr(0, set_cookie.find(';'));
    for (const std::string& path : {std::string("/"), std::string("/app.js"),
                                    std::string("/health"), "/volume/" + kBlobName}) {
      EXPECT_EQ(browser.Get(base + path, own).result_int(), 200u) << base + path;
    }
    EXPECT_EQ(browser.Join(own, base + "/stream").result_int(), 101u) << base;
  }
  Browser browser(rig);
  const WebResponse sent_on = browser.Get("/at/palpate", own);
  EXPECT_EQ(sent_on.result_int(), 308u);
  EXPECT_EQ(sent_on["Location"], "/at/palpate/");
  EXPECT_EQ(browser.Get("/at/palpated", own).result_int(), 404u);
}

TEST(WebHttp, APortInUseIsAConflict) {
  WebRig rig;
  asio::io_context io;
  web::Hub hub;
  web::HttpOptions options;
  options.listen = {"127.0.0.1", rig.port()};
  options.page_folder = rig.outside().parent_path();
  EXPECT_EQ(testing::Refusal([&] { web::HttpServer(io, hub, options, {}, {}); }),
            ErrorKind::kConflict);
}

TEST(WebHttp, PublicUrlIsTheOnlyOrigin) {
  web::HttpOptions options;
  options.behind_proxy = true;
  options.public_url = "https://Palpate.example.org/";
  const web::Origins origins(options, 7480);
  EXPECT_TRUE(origins.is_https());
  EXPECT_TRUE(origins.AllowsOrigin("https://palpate.example.org"));
  EXPECT_TRUE(origins.AllowsHost("palpate.example.org"));
  EXPECT_TRUE(origins.AllowsHost("palpate.example.org:443"));
  EXPECT_FALSE(origins.AllowsOrigin("http://palpate.example.org"));
  EXPECT_FALSE(origins.AllowsOrigin("https://palpate.example.org:7480"));
  EXPECT_FALSE(origins.AllowsOrigin("http://127.0.0.1:7480"));
  EXPECT_FALSE(origins.AllowsHost("127.0.0.1:7480"));
}

}  // namespace
}  // namespace palpate::test
