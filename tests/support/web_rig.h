// The server for browsers in this process, with a hub that the test fills, and browsers that talk
// to it. Also such that misbehave.
#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <chrono>
#include <fstream>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "client/web/http/server.h"
#include "tests/support/patience.h"
#include "tests/support/temporary_folder.h"

namespace palpate::test {

namespace asio = boost::asio;
namespace http = boost::beast::http;
namespace websocket = boost::beast::websocket;
using asio::ip::tcp;

inline const std::string kRoomKey = "the-key-of-the-room";
inline const std::string kRoomLogin = R"({"room":")" + kRoomKey + "\"}";
inline const std::string kToken = "the-token-of-the-lecturer";
inline const std::string kBlobName(32, 'a');
constexpr std::size_t kBigBlobBytes = std::size_t{7} << 20;
inline const std::string kBigBlobName(32, 'c');  // more than the system keeps for a socket
inline const std::string kManifestName(32, 'f');
constexpr std::size_t kNoiseBytes = std::size_t{3} << 20;

// A blob that does not compress. `n`: 0 to 99.
inline std::string NoiseName(int n) { return std::to_string(100 + n) + std::string(29, 'e'); }
inline std::string Noise() {
  std::string bytes(kNoiseBytes, '\0');
  std::mt19937 random(3);
  for (char& byte : bytes) byte = static_cast<char>(random());
  return bytes;
}

using Fields = std::map<std::string, std::string>;
using WebResponse = http::response<http::string_body>;
using ErrorCode = boost::beast::error_code;

class WebRig {
 public:
  explicit WebRig(web::HttpOptions options = {}, web::AccessOptions access = DefaultAccess()) {
    std::ofstream(page_.path() / "index.html") << "<!doctype html><title>page</title>";
    std::ofstream(page_.path() / "app.js") << std::string(5000, ' ') << "let page = 1;";
    std::ofstream(outside_.path() / "secret") << "secret";
    options.listen = {"127.0.0.1", 0};
    options.page_folder = page_.path();
    FillHub();
    server_ = std::make_unique<web::HttpServer>(io_, hub_, options, std::move(access), Events());
    thread_ = std::thread([this] { io_.run(); });
  }
  ~WebRig() {
    OnNetwork([&] {
      server_->Stop();
      feed_.reset();
    });
    keep_.reset();
    // Timers of Boost.Beast may still wait.
    io_.stop();
    thread_.join();
  }
  WebRig(const WebRig&) = delete;
  WebRig& operator=(const WebRig&) = delete;

  static web::AccessOptions DefaultAccess() {
    web::AccessOptions access;
    access.room_key = kRoomKey;
    access.users = {{"lecturer", web::ToHex(web::Sha256(kToken)), {"isovalue", "pop_force_n"}}};
    return access;
  }

  web::Hub& hub() { return hub_; }                // on the network thread only
  web::HttpServer& server() { return *server_; }  // the same
  std::uint16_t port() const { return server_->port(); }
  std::string host() const { return "127.0.0.1:" + std::to_string(port()); }
  std::string origin() const { return "http://" + host(); }
  std::filesystem::path outside() const { return outside_.path() / "secret"; }

  // Calls it on the network thread, and waits.
  template <class Call>
  std::invoke_result_t<Call> OnNetwork(Call call) {
    std::packaged_task<std::invoke_result_t<Call>()> task(std::move(call));
    auto result = task.get_future();
    asio::post(io_, [&task] { task(); });
    return result.get();
  }
  web::HttpServer::Counts counts() {
    return OnNetwork([&] { return server_->counts(); });
  }
  void Put(web::Topic topic, const std::string& json) {
    OnNetwork([&] { hub_.Put(topic, json); });
  }
  void PutPoses(int count) {
    OnNetwork([&] {
      for (int n = 0; n < count; ++n) hub_.PutPose(std::string(176, '\1'));
    });
  }
  // Poses come from now on, many a second, and a topic that changes with each.
  void Feed(std::size_t text_bytes = 100) {
    OnNetwork([&] { FeedAgain(text_bytes); });
  }
  std::vector<web::SteerRequest> steered() {
    return OnNetwork([&] { return steered_; });
  }
  int refused(const std::string& kind) {
    return OnNetwork([&] { return refused_[kind]; });
  }
  int left(const std::string& kind) {
    return OnNetwork([&] { return left_[kind]; });
  }
  std::string log() {
    return OnNetwork([&] { return log_; });
  }

 private:
  void FillHub() {
    hub_.find_blob = [](std::string_view name) -> web::BlobPtr {
      const auto bytes_of = [name]() -> std::function<std::string()> {
        if (name == kBlobName) return [] { return std::string(32768, 'v'); };
        if (name == kBigBlobName) return [] { return std::string(kBigBlobBytes, 'v'); };
        if (name == kManifestName) return [] { return std::string("{}"); };
        if (name.ends_with(std::string(29, 'e'))) return Noise;
        return nullptr;
      };
      const std::function<std::string()> bytes = bytes_of();
      if (bytes == nullptr) return nullptr;
      return std::make_shared<const web::Blob>(
          std::string(name),
          name == kManifestName ? "application/json" : "application/octet-stream", bytes);
    };
    hub_.steer = [this](web::SteerRequest request, std::function<void(std::string)> done) {
      steered_.push_back(std::move(request));
      done("");
    };
    hub_.health = [] { return std::string(); };
    hub_.hello = [](const std::string& user, const std::vector<std::string>&) {
      return R"({"type":"hello","user":")" + user + "\"}";
    };
  }
  web::HttpEvents Events() {
    web::HttpEvents events;
    events.log = [this](const std::string& line) { log_ += line + "\n"; };
    events.refused = [this](std::string_view kind) { ++refused_[std::string(kind)]; };
    events.left = [this](std::string_view kind) { ++left_[std::string(kind)]; };
    return events;
  }
  void FeedAgain(std::size_t text_bytes) {
    hub_.PutPose(std::string(176, '\1'));
    hub_.Put(web::Topic::kSettings, R"({"type":"settings","n":)" + std::to_string(++fed_) +
                                        R"(,"filler":")" + std::string(text_bytes, 'x') + "\"}");
    if (!feed_) feed_ = std::make_unique<asio::steady_timer>(io_);
    feed_->expires_after(std::chrono::milliseconds(2));
    feed_->async_wait([this, text_bytes](ErrorCode error) {
      if (!error) FeedAgain(text_bytes);
    });
  }

  TemporaryFolder page_, outside_;
  asio::io_context io_{1};
  asio::executor_work_guard<asio::io_context::executor_type> keep_{io_.get_executor()};
  web::Hub hub_;
  std::unique_ptr<web::HttpServer> server_;
  std::unique_ptr<asio::steady_timer> feed_;
  int fed_ = 0;
  std::vector<web::SteerRequest> steered_;
  std::map<std::string, int> refused_, left_;
  std::string log_;
  std::thread thread_;
};

// Addresses of this machine: each is another network to the server.
constexpr const char* kHere = "127.0.0.1";
constexpr const char* kElsewhere = "127.0.0.2";

inline void ConnectFrom(const char* from, tcp::socket& socket, WebRig& rig) {
  socket.open(tcp::v4());
  socket.bind({asio::ip::make_address(from), 0});
  socket.connect({asio::ip::make_address(kHere), rig.port()});
}

// One connection of a browser, or of who pretends to be one.
class Browser {
 public:
  explicit Browser(WebRig& rig, const char* from = kHere) : rig_(rig), from_(from), socket_(io_) {
    Connect();
  }

  void Connect() {
    socket_ = tcp::socket(io_);
    buffer_.clear();
    ConnectFrom(from_, socket_, rig_);
  }

  // As the page sends it; `fields` replace the page's, and an empty value leaves one out.
  WebResponse Send(http::verb method, const std::string& path, const std::string& body = "",
                   const Fields& fields = {}) {
    http::request<http::string_body> request(method, path, 11);
    Fields all = {{"Host", rig_.host()}, {"Origin", rig_.origin()}};
    if (!body.empty()) all["Content-Type"] = "application/json";
    if (!cookie.empty()) all["Cookie"] = cookie;
    for (const auto& [name, value] : fields) all[name] = value;
    for (const auto& [name, value] : all) {
      if (!value.empty()) request.set(name, value);
    }
    request.body() = body;
    if (method == http::verb::post) request.prepare_payload();
    ErrorCode ignored;
    http::write(socket_, request, ignored);
    return Receive();
  }
  WebResponse Get(const std::string& path, const Fields& fields = {}) {
    return Send(http::verb::get, path, "", fields);
  }
  // Asks for a WebSocket.
  WebResponse Join(const Fields& fields = {}, const std::string& path = "/stream") {
    Fields all = {{"Connection", "Upgrade"},
                  {"Upgrade", "websocket"},
                  {"Sec-WebSocket-Version", "13"},
                  {"Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ=="}};
    for (const auto& [name, value] : fields) all[name] = value;
    return Get(path, all);
  }
  // Any bytes. False: the connection is closed.
  bool SendBytes(const std::string& bytes) {
    ErrorCode error;
    asio::write(socket_, asio::buffer(bytes), error);
    return !error;
  }
  // Status 0: the connection ended before an answer.
  WebResponse Receive() {
    WebResponse response;
    ErrorCode error;
    http::read(socket_, buffer_, response, error);
    if (error) response.result(0);
    return response;
  }
  // True once the server has closed the connection. Waits for it.
  bool IsClosed() {
    ErrorCode error;
    char byte;
    while (!error) socket_.read_some(asio::buffer(&byte, 1), error);
    return error == asio::error::eof || error == asio::error::connection_reset;
  }

  // Remembers the cookie.
  WebResponse LogIn(const std::string& body = kRoomLogin, const Fields& fields = {}) {
    WebResponse response = Send(http::verb::post, "/login", body, fields);
    const std::string set_cookie(response["Set-Cookie"]);
    if (!set_cookie.empty()) cookie = set_cookie.substr(0, set_cookie.find(';'));
    return response;
  }
  WebResponse LogInAsLecturer() { return LogIn(R"({"token":")" + kToken + "\"}"); }

  std::string cookie;

 private:
  WebRig& rig_;
  const char* const from_;
  asio::io_context io_;
  tcp::socket socket_;
  boost::beast::flat_buffer buffer_;
};

// A guest's WebSocket.
class TestGuest {
 public:
  // Logs in first. Fails the test if that is refused.
  explicit TestGuest(WebRig& rig, const std::string& login = kRoomLogin)
      : TestGuest(rig, {}, login) {}
  TestGuest(WebRig& rig, const Fields& fields, const std::string& login, const char* from = kHere)
      : socket_(io_) {
    Browser browser(rig, from);
    if (!login.empty()) browser.LogIn(login);
    Fields all = {{"Origin", rig.origin()}, {"Cookie", browser.cookie}};
    for (const auto& [name, value] : fields) all[name] = value;
    socket_.set_option(websocket::stream_base::decorator([&](websocket::request_type& request) {
      for (const auto& [name, value] : all) {
        if (!value.empty()) request.set(name, value);
      }
    }));
    ConnectFrom(from, socket_.next_layer(), rig);
    const auto host = all.find("Host");
    socket_.handshake(answer, host == all.end() ? rig.host() : host->second, "/stream", error);
  }

  bool is_open() const { return !error; }
  // The next message; "" at the end of the connection.
  std::string Read() {
    boost::beast::flat_buffer buffer;
    if (!error) socket_.read(buffer, error);
    return error ? "" : boost::beast::buffers_to_string(buffer.data());
  }
  bool got_text() const { return socket_.got_text(); }
  // Reads until a message has this text in it; "" at the end of the connection.
  std::string ReadUntil(const std::string& part) {
    std::string text;
    do text = Read();
    while (!error && text.find(part) == std::string::npos);
    return text;
  }
  void Send(const std::string& text) {
    socket_.text(true);
    if (!error) socket_.write(asio::buffer(text), error);
  }
  void SendBinary(const std::string& bytes) {
    socket_.binary(true);
    if (!error) socket_.write(asio::buffer(bytes), error);
  }
  // Reads to the end; the code that the server gave, 0 for none.
  int CloseCode() {
    while (!error) Read();
    return socket_.reason().code;
  }
  tcp::socket& tcp_socket() { return socket_.next_layer(); }

  ErrorCode error;
  websocket::response_type answer;

 private:
  asio::io_context io_;
  websocket::stream<tcp::socket, false> socket_;
};

}  // namespace palpate::test
