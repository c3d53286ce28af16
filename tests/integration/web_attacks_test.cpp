// Attacks on the gateway: floods, half requests, random bytes. A guest who watches goes on, and the
// next one still gets in.
#include <gtest/gtest.h>

#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "client/web/http/connections.h"
#include "tests/support/certificates.h"
#include "tests/support/refusal.h"
#include "tests/support/web_rig.h"

namespace palpate::test {
namespace {

using std::chrono::milliseconds;

// A guest who watches: fails the test if the stream stops.
void ExpectGoesOn(WebRig& rig, TestGuest& guest) {
  static int count = 0;
  const std::string text = R"({"n":)" + std::to_string(++count) + "}";
  rig.Put(web::Topic::kSeries, text);
  EXPECT_NE(guest.ReadUntil(text), "");
}

TEST(WebAttacks, AThousandConnections) {
  WebRig rig;
  TestGuest guest(rig);
  Browser idle(rig);
  idle.LogIn();
  std::vector<std::unique_ptr<Browser>> flood;
  for (int n = 0; n < 1000; ++n) {
    flood.push_back(std::make_unique<Browser>(rig));
    if (n % 3 == 1) flood.back()->SendBytes("GET / HTTP/1.1\r\n");
    if (n % 3 == 2)
      flood.back()->SendBytes("GET /app.js HTTP/1.1\r\nHost: " + rig.host() + "\r\n\r\n");
    if (n % 100 == 0) ExpectGoesOn(rig, guest);
  }
  // The server may still have some to accept.
  EXPECT_TRUE(flood.front()->IsClosed());
  EXPECT_TRUE(Eventually([&] { return rig.counts().strangers == 64; }));
  EXPECT_LE(rig.counts().connections, 64 + 2);
  ExpectGoesOn(rig, guest);
  EXPECT_EQ(idle.Get("/volume/" + kBlobName).result_int(), 200u);
  TestGuest late(rig);
  EXPECT_TRUE(late.is_open());
  ExpectGoesOn(rig, late);
}

TEST(WebAttacks, OneSessionWithAllConnectionsShutsOutNobody) {
  web::HttpOptions options;
  options.max_connections = 20;
  WebRig rig(options);
  TestGuest guest(rig);
  EXPECT_TRUE(Eventually([&] { return rig.counts().connections == 1; }));
  std::vector<std::unique_ptr<Browser>> others, greedy;
  const auto open = [&](std::vector<std::unique_ptr<Browser>>& browsers) -> Browser& {
    return *browsers.emplace_back(std::make_unique<Browser>(rig));
  };
  for (int n = 0; n < 6; ++n) EXPECT_EQ(open(others).LogIn().result_int(), 200u);
  EXPECT_EQ(open(greedy).LogIn().result_int(), 200u);
  while (rig.counts().connections < 20) {
    Browser& browser = open(greedy);
    browser.cookie = greedy.front()->cookie;
    EXPECT_EQ(browser.Get("/volume/" + kBlobName).result_int(), 200u);
  }
  for (int n = 0; n < 10; ++n) EXPECT_EQ(open(others).LogIn().result_int(), 200u);
  EXPECT_EQ(rig.counts().connections, 20);
  for (const auto& browser : others) {
    EXPECT_EQ(browser->Get("/volume/" + kBlobName).result_int(), 200u);
  }
  for (std::size_t n = 0; n < greedy.size(); ++n) {
    EXPECT_EQ(greedy[n]->Get("/volume/" + kBlobName).result_int(), n < 10 ? 0u : 200u) << n;
  }
  ExpectGoesOn(rig, guest);
}

// Which of twenty sockets in use, all of one network, is closed for one more; -1: none.
int ClosedForOneMore(int of_one_session, const std::string& newcomer) {
  web::Connections connections(20, 20);
  const auto login = [] {
    auto session = std::make_shared<web::Session>();
    session->network = "hall";
    return session;
  };
  const auto one = login();
  std::vector<std::unique_ptr<web::Connections::Ticket>> tickets;
  int closed = -1;
  for (int n = 0; n < 20; ++n) {
    tickets.push_back(connections.Admit("hall"));
    tickets.back()->LoggedIn(n < 20 - of_one_session ? login() : one);
    tickets.back()->use = web::Connections::Ticket::Use::kRequest;
    tickets.back()->close = [&closed, n] { closed = n; };
  }
  const bool is_admitted = connections.Admit(newcomer) != nullptr;
  EXPECT_EQ(is_admitted, closed >= 0);
  return closed;
}

TEST(WebAttacks, OnlyWhoHasManySocketsInUseLosesOne) {
  EXPECT_EQ(ClosedForOneMore(1, "hall"), -1);
  EXPECT_EQ(ClosedForOneMore(16, "hall"), -1);
  EXPECT_EQ(ClosedForOneMore(17, "hall"), 3);
}

TEST(WebAttacks, ANetworkWithAllSocketsInUseLosesOneToAnother) {
  EXPECT_EQ(ClosedForOneMore(1, "elsewhere"), 0);
  EXPECT_EQ(ClosedForOneMore(4, "elsewhere"), 16);
}

TEST(WebAttacks, TheNetworkWithMostGivesWay) {
  EXPECT_EQ(web::NetworkWithMost({}), "");
  EXPECT_EQ(web::NetworkWithMost({"a", "b"}), "a");
  EXPECT_EQ(web::NetworkWithMost({"a", "b", "c", "c", "b"}), "b");
  using Networks = std::vector<std::string_view>;
  const Networks hall = {"hall", "a", "hall", "b", "hall", "b"};
  EXPECT_EQ(web::WhoGivesWay(hall, "c"), 4u);
  EXPECT_EQ(web::WhoGivesWay(hall, "a"), 4u);
  // With one more it would have as many as the hall has now: nothing would be fairer.
  EXPECT_EQ(web::WhoGivesWay(hall, "b"), std::nullopt);
  EXPECT_EQ(web::WhoGivesWay(hall, "hall"), std::nullopt);
  EXPECT_EQ(web::WhoGivesWay(Networks{"a", "b", "c"}, "d"), std::nullopt);
}

TEST(WebAttacks, NetworksOfAddresses) {
  EXPECT_EQ(web::NetworkOf("10.0.0.7"), "10.0.0.7");
  EXPECT_EQ(web::NetworkOf("::ffff:10.0.0.7"), "10.0.0.7");
  EXPECT_EQ(web::NetworkOf("2001:db8:0:1:2:3:4:5"), web::NetworkOf("2001:db8:0:1::"));
  EXPECT_NE(web::NetworkOf("2001:db8:0:1::"), web::NetworkOf("2001:db8:0:2::"));
  EXPECT_EQ(web::NetworkOf("unknown"), "unknown");
}

TEST(WebAttacks, OneSessionWithManyWebSocketsShutsOutNobody) {
  web::HttpOptions options;
  options.max_guests = 6;
  WebRig rig(options);
  TestGuest guest(rig);
  Browser browser(rig);
  browser.LogIn();
  std::vector<std::unique_ptr<TestGuest>> tabs;
  for (int n = 0; n < 20; ++n) {
    tabs.push_back(std::make_unique<TestGuest>(rig, Fields{{"Cookie", browser.cookie}}, ""));
    EXPECT_TRUE(tabs.back()->is_open());
  }
  EXPECT_EQ(rig.counts().guests, 5);
  for (int n = 0; n < 16; ++n) EXPECT_EQ(tabs[n]->CloseCode(), 0);
  for (int n = 16; n < 20; ++n) ExpectGoesOn(rig, *tabs[n]);
  ExpectGoesOn(rig, guest);
  EXPECT_TRUE(TestGuest(rig).is_open());
}

// One who never reads the answer to this request.
std::unique_ptr<Browser> Unread(WebRig& rig, const char* from) {
  auto browser = std::make_unique<Browser>(rig, from);
  browser->LogIn();
  browser->SendBytes("GET /volume/" + kBigBlobName + " HTTP/1.1\r\nHost: " + rig.host() +
                     "\r\nCookie: " + browser->cookie + "\r\n\r\n");
  return browser;
}

// A newcomer gets a seat and a large part of the volume.
bool GetsIn(WebRig& rig, const std::string& login = kRoomLogin) {
  TestGuest guest(rig, {}, login);
  Browser browser(rig);
  browser.LogIn(login);
  return guest.ReadUntil("hello") != "" &&
         browser.Get("/volume/" + kBigBlobName).body().size() == kBigBlobBytes;
}

TEST(WebAttacks, WhoHoldsAllThatOneMayHoldShutsOutNobody) {
  web::HttpOptions options;
  options.max_guests = 12;
  options.max_held_bytes = 10 * kBigBlobBytes;
  options.timeouts.lowest_bytes_per_ms = 1;
  options.timeouts.keep_alive = std::chrono::minutes(5);  // who is slow is not gone
  WebRig rig(options);
  std::vector<std::unique_ptr<TestGuest>> seats;
  while (rig.counts().guests < 12) {
    seats.push_back(std::make_unique<TestGuest>(rig, Fields{}, kRoomLogin, kElsewhere));
  }
  std::vector<std::unique_ptr<Browser>> unread;
  while (rig.refused("memory") == 0) unread.push_back(Unread(rig, kElsewhere));
  for (int n = 0; n < 20; ++n) EXPECT_TRUE(GetsIn(rig)) << n;
  // Nor is anybody put out who need not be.
  EXPECT_EQ(rig.left("full"), 1);
  ExpectGoesOn(rig, *seats.front());
}

// In the same hall: whoever has one login more, or a name.
TEST(WebAttacks, OneLoginWithAllUnreadAnswersShutsOutNoNeighbour) {
  web::HttpOptions options;
  options.max_held_bytes = 10 * kBigBlobBytes;
  options.timeouts.lowest_bytes_per_ms = 1;
  WebRig rig(options);
  std::vector<std::unique_ptr<Browser>> unread;
  unread.push_back(Unread(rig, kHere));
  while (rig.refused("memory") == 0) {
    unread.push_back(std::make_unique<Browser>(rig));
    unread.back()->SendBytes("GET /volume/" + kBigBlobName + " HTTP/1.1\r\nHost: " + rig.host() +
                             "\r\nCookie: " + unread.front()->cookie + "\r\n\r\n");
  }
  for (int n = 0; n < 20; ++n) EXPECT_TRUE(GetsIn(rig)) << n;
}

TEST(WebAttacks, AFullHallHasASeatForTheLecturer) {
  web::HttpOptions options;
  options.max_guests = 12;
  WebRig rig(options);
  std::vector<std::unique_ptr<TestGuest>> seats;
  while (rig.counts().guests < 12) seats.push_back(std::make_unique<TestGuest>(rig));
  EXPECT_FALSE(GetsIn(rig));
  EXPECT_TRUE(GetsIn(rig, R"({"token":")" + kToken + "\"}"));
  ExpectGoesOn(rig, *seats.front());
}

// More strangers than may be, and the last of them is served: so all are accepted.
void Flood(WebRig& rig, std::vector<std::unique_ptr<Browser>>& flood, const Fields& fields = {}) {
  for (int n = 0; n < 70; ++n) {
    flood.push_back(std::make_unique<Browser>(rig, kElsewhere));
    if (!fields.empty()) flood.back()->Get("/", fields);
  }
  EXPECT_EQ(flood.back()->Get("/", fields).result_int(), 200u);
}

TEST(WebAttacks, StrangersOfOneAddressShutOutNobody) {
  WebRig rig;
  std::vector<std::unique_ptr<Browser>> flood;
  for (int n = 0; n < 20; ++n) {
    Browser newcomer(rig);
    Flood(rig, flood);
    EXPECT_EQ(newcomer.LogIn().result_int(), 200u) << n;
  }
  EXPECT_TRUE(GetsIn(rig));
}

// All come from the proxy's address. It names theirs with each request.
TEST(WebAttacks, StrangersOfOneAddressBehindAProxyShutOutNobody) {
  web::HttpOptions options;
  options.behind_proxy = true;
  options.public_url = "https://palpate.example.org";
  WebRig rig(options);
  Fields stranger = {{"Host", "palpate.example.org"},
                     {"Origin", "https://palpate.example.org"},
                     {"X-Forwarded-For", "2001:db8:0:1::1"}};
  std::vector<std::unique_ptr<Browser>> flood;
  for (int n = 0; n < 20; ++n) {
    Browser newcomer(rig, kElsewhere);
    Fields fields = stranger;
    fields["X-Forwarded-For"] = "2001:db8:0:2::1";
    EXPECT_EQ(newcomer.Get("/", fields).result_int(), 200u);
    Flood(rig, flood, stranger);
    EXPECT_EQ(newcomer.LogIn(kRoomLogin, fields).result_int(), 200u) << n;
  }
}

TEST(WebAttacks, RequestsThatAreTooLarge) {
  WebRig rig;
  const auto status = [&](const std::string& bytes) {
    Browser browser(rig);
    browser.SendBytes(bytes);
    const WebResponse answer = browser.Receive();
    EXPECT_TRUE(browser.IsClosed());
    return answer.result_int();
  };
  const std::string host = "Host: " + rig.host() + "\r\n";
  EXPECT_EQ(status("GET / HTTP/1.1\r\n" + host + "Cookie: " + std::string(9000, 'x') + "\r\n\r\n"),
            431u);
  EXPECT_EQ(status("GET /" + std::string(9000, 'x') + " HTTP/1.1\r\n" + host + "\r\n"), 431u);
  EXPECT_EQ(status("GET / HTTP/1.1\r\n" + std::string(9000, 'x')), 431u);
  const std::string post = "POST /login HTTP/1.1\r\n" + host;
  EXPECT_EQ(status(post + "Content-Length: 4097\r\n\r\n" + std::string(4097, 'x')), 413u);
  EXPECT_EQ(status(post + "Content-Length: 99999999999\r\n\r\n" + std::string(9000, 'x')), 413u);
  EXPECT_EQ(status(post + "Transfer-Encoding: chunked\r\n\r\n2000\r\n" + std::string(0x2000, 'x') +
                   "\r\n0\r\n\r\n"),
            413u);
  // What just fits is read.
  Browser browser(rig);
  EXPECT_EQ(browser.LogIn(std::string(4096, 'x')).result_int(), 400u);
  EXPECT_EQ(browser.Get("/", {{"Cookie", std::string(7000, 'x')}}).result_int(), 200u);
}

TEST(WebAttacks, MalformedRequests) {
  WebRig rig;
  const std::string host = "Host: " + rig.host() + "\r\n";
  for (const std::string& bytes :
       {std::string("GET\r\n\r\n"), std::string("GET / HTTP/9.9\r\n\r\n"),
        std::string("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", 11),
        "GET / HTTP/1.1\r\n" + host + "Bad Header\r\n\r\n",

        "GET / HTTP/1.1\r\n" + host + std::string("X: \0\r\n\r\n", 8),
        "POST /login HTTP/1.1\r\n" + host + "Content-Length: -1\r\n\r\n",
        "POST /login HTTP/1.1\r\n" + host + "Content-Length: 1\r\nContent-Length: 2\r\n\r\n",
        "POST /login HTTP/1.1\r\n" + host + "Content-Length: 18446744073709551616\r\n\r\n",
        "POST /login HTTP/1.1\r\n" + host + "Transfer-Encoding: chunked\r\n\r\nZZ\r\n",
        "POST /login HTTP/1.1\r\n" + host +
            "Transfer-Encoding: chunked\r\nContent-Length: 5\r\n\r\n0\r\n\r\n"}) {
    Browser browser(rig);
    browser.SendBytes(bytes);
    EXPECT_EQ(browser.Receive().result_int(), 400u) << bytes;
    EXPECT_TRUE(browser.IsClosed()) << bytes;
  }
  EXPECT_EQ(Browser(rig).LogIn().result_int(), 200u);
}

TEST(WebAttacks, RequestsThatDoNotEnd) {
  web::HttpOptions options;
  options.timeouts.request = options.timeouts.keep_alive = std::chrono::seconds(1);
  WebRig rig(options);
  // Nothing, a part of a header, a part of a body, and nothing more after an answer.
  Browser silent(rig), header(rig), body(rig), answered(rig);
  header.SendBytes("GET / HTTP/1.1\r\nHost: ");
  body.SendBytes("POST /login HTTP/1.1\r\nHost: " + rig.host() +
                 "\r\nContent-Length: 100\r\n\r\n{");
  EXPECT_EQ(answered.Get("/").result_int(), 200u);
  for (Browser* browser : {&silent, &header, &body, &answered}) EXPECT_TRUE(browser->IsClosed());
  // Byte by byte, which never ends by itself.
  Browser slow(rig);
  while (slow.SendBytes("x")) std::this_thread::sleep_for(milliseconds(5));
  EXPECT_TRUE(Eventually([&] { return rig.counts().connections == 0; }));
  EXPECT_GT(rig.refused("slow"), 0);
}

TEST(WebAttacks, AnswersThatAreNotRead) {
  web::HttpOptions options;
  options.timeouts.write = std::chrono::seconds(2);
  options.timeouts.lowest_bytes_per_ms = 1 << 20;
  options.max_held_bytes = 3 * kBigBlobBytes + 5000;
  WebRig rig(options);
  TestGuest guest(rig);
  std::vector<std::unique_ptr<Browser>> slow;
  const std::string request =
      "GET /volume/" + kBigBlobName + " HTTP/1.1\r\nHost: " + rig.host() + "\r\nCookie: ";
  for (int n = 0; n < 6; ++n) {
    slow.push_back(std::make_unique<Browser>(rig));
    slow.back()->LogIn();
    slow.back()->SendBytes(request + slow.back()->cookie + "\r\n\r\n");
  }
  // Three fit.
  EXPECT_TRUE(Eventually([&] { return rig.refused("memory") > 0; }));
  EXPECT_LE(rig.counts().held_bytes, options.max_held_bytes + 1000);
  ExpectGoesOn(rig, guest);
  EXPECT_TRUE(Eventually([&] { return rig.counts().held_bytes < 1000; }));
  Browser late(rig);
  late.LogIn();
  EXPECT_EQ(late.Get("/volume/" + kBigBlobName).body().size(), kBigBlobBytes);
}

TEST(WebAttacks, SharedAnswersAreHeldOnce) {
  web::HeldBodies bodies(1'000'000);
  const web::HeldBodies::Holder here{"hall", "guest-1"}, there{"hall", "guest-2"};
  const auto a = std::make_shared<const std::string>(600'000, 'a');
  const auto b = std::make_shared<const std::string>(100'000, 'b');
  for (const auto& holder : {here, there, here}) EXPECT_TRUE(bodies.Hold(a, holder));
  EXPECT_EQ(bodies.bytes(), 600'000u);
  EXPECT_FALSE(bodies.Hold(b, here));
  for (const auto& holder : {here, there}) bodies.Release(a, holder);
  EXPECT_EQ(bodies.bytes(), 600'000u);
  bodies.Release(a, here);
  EXPECT_EQ(bodies.bytes(), 0u);
  EXPECT_TRUE(bodies.Hold(b, here));
  EXPECT_TRUE(bodies.Hold(nullptr, here));
}

// Each takes what it gets, in bodies of a hundredth of all.
TEST(WebAttacks, WhoeverHoldsLeavesAsMuchToOthers) {
  web::HeldBodies bodies(10'000'000);
  std::vector<web::Body> alive;
  const auto take = [&](const web::HeldBodies::Holder& holder) {
    const std::size_t before = alive.size();
    do alive.push_back(std::make_shared<const std::string>(100'000, 'x'));
    while (bodies.Hold(alive.back(), holder));
    return static_cast<int>(alive.size() - before) - 1;
  };
  EXPECT_EQ(take({"hall", "guest-1"}), 34);
  EXPECT_EQ(take({"hall", "guest-2"}), 11);
  int others = 0;
  for (int n = 3; n < 100; ++n) others += take({"hall", "guest-" + std::to_string(n)});
  EXPECT_LE(34 + 11 + others, 50);
  EXPECT_GE(take({"home", "guest-100"}), 16);
  // What is small is held in any case.
  const auto login = std::make_shared<const std::string>(web::HeldBodies::kSmallBytes, 'x');
  EXPECT_TRUE(bodies.Hold(login, {"hall", "guest-1"}));
}

std::string RandomBytes(std::mt19937& random, std::size_t most) {
  std::string bytes(random() % most, '\0');
  for (char& byte : bytes) byte = static_cast<char>(random());
  return bytes;
}

std::string Mutated(std::mt19937& random, std::string bytes) {
  for (unsigned changes = random() % 4; changes > 0 && !bytes.empty(); --changes) {
    const std::size_t at = random() % bytes.size();
    switch (random() % 4) {
      case 0:
        bytes[at] = static_cast<char>(random());
        break;
      case 1:
        bytes.erase(at, random() % 20);
        break;
      case 2:
        bytes.insert(at, bytes.substr(random() % bytes.size(), random() % 40));
        break;
      default:
        bytes.insert(at, RandomBytes(random, 20));
    }
  }
  return bytes;
}

// A masked frame whose head may be anything.
std::string RandomFrame(std::mt19937& random) {
  std::string frame;
  frame += static_cast<char>(random() % 4 == 0 ? random() : 0x81);
  const std::string payload =
      random() % 2 == 0 ? RandomBytes(random, 120) : R"({"type":"steer","id":1,"key":"isovalue"})";
  frame += static_cast<char>(random() % 8 == 0 ? random() : (0x80 | payload.size()));
  frame += std::string(4, '\0');
  return frame + payload;
}

TEST(WebAttacks, RandomBytes) {
  const char* const torture = std::getenv("PALPATE_TORTURE");
  const int rounds = 300 * (torture != nullptr ? std::max(1, std::atoi(torture)) : 1);
  WebRig rig;
  TestGuest guest(rig);
  Browser member(rig);
  member.LogIn();
  const std::string head = "Host: " + rig.host() + "\r\nOrigin: " + rig.origin() +
                           "\r\nCookie: " + member.cookie + "\r\n";
  const std::vector<std::string> requests = {
      "GET / HTTP/1.1\r\n" + head + "\r\n",
      "GET /volume/" + kBlobName + " HTTP/1.1\r\n" + head + "Accept-Encoding: zstd, gzip\r\n\r\n",
      "POST /login HTTP/1.1\r\n" + head +
          "Content-Type: application/json\r\nContent-Length: 32\r\n\r\n" + R"({"room":")" +
          std::string(20, 'x') + "\"}}",
      "POST /login HTTP/1.1\r\n" + head +
          "Content-Type: application/json\r\nTransfer-Encoding: "
          "chunked\r\n\r\n4\r\n{}{}\r\n0\r\n\r\n",
      "GET /stream HTTP/1.1\r\n" + head +
          "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
          "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"};
  std::mt19937 random(11);
  std::vector<std::unique_ptr<Browser>> open;
  for (int n = 0; n < rounds; ++n) {
    open.push_back(std::make_unique<Browser>(rig));
    Browser& browser = *open.back();
    if (random() % 8 == 0) {
      browser.SendBytes(RandomBytes(random, 9000));
    } else {
      const std::string bytes = Mutated(random, requests[random() % requests.size()]);
      const std::size_t half = random() % (bytes.size() + 1);
      browser.SendBytes(bytes.substr(0, half));
      browser.SendBytes(bytes.substr(half));
      for (unsigned frames = random() % 4; frames > 0; --frames) {
        browser.SendBytes(RandomFrame(random));
      }
    }
    if (random() % 2 == 0) open.erase(open.begin() + static_cast<long>(random() % open.size()));
    if (open.size() > 40) open.clear();
    if (n % 50 == 0) ExpectGoesOn(rig, guest);
  }
  open.clear();
  ExpectGoesOn(rig, guest);
  EXPECT_TRUE(TestGuest(rig).is_open());
  EXPECT_TRUE(Eventually([&] { return rig.counts().guests == 1; }));
  EXPECT_EQ(rig.steered().size(), 0u);
}

class WebTls : public ::testing::Test {
 protected:
  WebTls() {
    certificates_.MakeAuthority("gateway");
    options_.certificate_file = certificates_.In("gateway.pem");
    options_.key_file = certificates_.In("gateway.key");
  }
  Certificates certificates_;
  web::HttpOptions options_;
};

TEST_F(WebTls, GuestsGetInAndCookiesAreSecure) {
  WebRig rig(options_);
  asio::io_context io;
  asio::ssl::context tls(asio::ssl::context::tls_client);
  tls.load_verify_file(certificates_.In("gateway.pem").string());
  tls.set_verify_mode(asio::ssl::verify_peer);
  const std::string origin = "https://" + rig.host();
  using TlsStream = asio::ssl::stream<tcp::socket>;
  const auto connect = [&](TlsStream& stream) {
    stream.next_layer().connect({asio::ip::make_address("127.0.0.1"), rig.port()});
    stream.handshake(asio::ssl::stream_base::client);
  };
  TlsStream stream(io, tls);
  connect(stream);
  http::request<http::string_body> request(http::verb::post, "/login", 11);
  request.set("Host", rig.host());
  request.set("Origin", origin);
  request.set("Content-Type", "application/json");
  request.body() = R"({"room":")" + kRoomKey + "\"}";
  request.prepare_payload();
  http::write(stream, request);
  boost::beast::flat_buffer buffer;
  WebResponse response;
  http::read(stream, buffer, response);
  const std::string cookie(response["Set-Cookie"]);
  EXPECT_NE(cookie.find("; Secure"), std::string::npos) << cookie;

  websocket::stream<TlsStream, false> guest(io, tls);
  connect(guest.next_layer());
  guest.set_option(websocket::stream_base::decorator([&](websocket::request_type& upgrade) {
    upgrade.set("Origin", origin);
    upgrade.set("Cookie", cookie.substr(0, cookie.find(';')));
  }));
  guest.handshake(rig.host(), "/stream");
  // A plain request, and one that stops within the handshake, cost it nothing.
  Browser plain(rig), half(rig);
  EXPECT_EQ(plain.Get("/").result_int(), 0u);
  half.SendBytes(std::string("\x16\x03\x01", 3));
  for (int n = 0; n < 50; ++n) {
    rig.Put(web::Topic::kSeries, std::to_string(n));
    rig.PutPoses(1);
  }
  std::string text;
  while (text != "49") {
    buffer.clear();
    guest.read(buffer);
    text = boost::beast::buffers_to_string(buffer.data());
  }
}

TEST_F(WebTls, AnotherKeyIsRefused) {
  certificates_.MakeAuthority("other");
  options_.key_file = certificates_.In("other.key");
  EXPECT_EQ(testing::Refusal([&] { WebRig rig(options_); }), ErrorKind::kInvalidArgument);
  options_.key_file.clear();
  EXPECT_EQ(testing::Refusal([&] { WebRig rig(options_); }), ErrorKind::kInvalidArgument);
}

}  // namespace
}  // namespace palpate::test
