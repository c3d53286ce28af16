// Plays guests of palpate-web: logs in, opens WebSockets, acknowledges poses as the page does, and
// prints what each guest got as JSON. All on one thread.
//
//   web_guests HOST PORT SECRET GUESTS SECONDS [STALLED [WINDOWS]]
//
// SECRET: the room's key. STALLED: further guests, which join and never read. WINDOWS: so many
// times SECONDS, each with a report of its own in a line; 1 unless given. Ages are against
// CLOCK_MONOTONIC: right on the gateway's and palpated's own machine.
#include <time.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <chrono>
#include <cstdint>
#include <exception>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "palpate/v1/envelope.pb.h"

namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;
namespace websocket = boost::beast::websocket;
using asio::ip::tcp;
using Socket = websocket::stream<tcp::socket, false>;
using nlohmann::json;

double NowMs() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) * 1e-6;
}

struct Target {
  tcp::endpoint endpoint;
  std::string host, secret;
};

std::string LogIn(asio::io_context& io, const Target& target) {
  tcp::socket socket(io);
  socket.connect(target.endpoint);
  http::request<http::string_body> request(http::verb::post, "/login", 11);
  request.set(http::field::host, target.host);
  request.set(http::field::origin, "http://" + target.host);
  request.set(http::field::content_type, "application/json");
  request.body() = json{{"room", target.secret}}.dump();
  request.prepare_payload();
  http::write(socket, request);
  boost::beast::flat_buffer buffer;
  http::response<http::string_body> response;
  http::read(socket, buffer, response);
  if (response.result() != http::status::ok) throw std::runtime_error("login: " + response.body());
  const std::string cookie(response[http::field::set_cookie]);
  return cookie.substr(0, cookie.find(';'));
}

std::unique_ptr<Socket> Join(asio::io_context& io, const Target& target) {
  const std::string cookie = LogIn(io, target);
  auto socket = std::make_unique<Socket>(io);
  socket->next_layer().connect(target.endpoint);
  socket->next_layer().set_option(tcp::no_delay(true));
  socket->set_option(websocket::stream_base::decorator([&](websocket::request_type& request) {
    request.set(http::field::origin, "http://" + target.host);
    request.set(http::field::cookie, cookie);
  }));
  socket->handshake(target.host, "/stream");
  return socket;
}

json Percentiles(std::vector<double>& values) {
  if (values.empty()) return nullptr;
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
  };
  return {{"p50", at(0.5)}, {"p99", at(0.99)}, {"worst", values.back()}};
}

class LoadGuest {
 public:
  LoadGuest(asio::io_context& io, const Target& target) : socket_(Join(io, target)) { Read(); }

  void BeginToCount() { *this->counts_ = {}; }
  bool is_lost() const { return is_lost_; }
  std::uint64_t poses() const { return counts_->poses; }
  // Once.
  json Report() {
    return {{"poses", counts_->poses},
            {"texts", counts_->texts},
            {"bytes", counts_->bytes},
            {"lost", is_lost_},
            {"age_ms", Percentiles(counts_->ages)},
            {"since_sent_ms", Percentiles(counts_->since_sent)},
            {"longest_gap_ms", counts_->longest_gap}};
  }

 private:
  struct Counts {
    std::uint64_t poses = 0, texts = 0, bytes = 0;
    std::vector<double> ages, since_sent;
    double last_ms = 0.0, longest_gap = 0.0;
  };

  void Read() {
    socket_->async_read(buffer_, [this](boost::beast::error_code error, std::size_t) {
      if (error) {
        is_lost_ = true;
        return;
      }
      Take();
      buffer_.clear();
      Read();
    });
  }

  void Take() {
    const auto bytes = buffer_.data();
    counts_->bytes += bytes.size();
    if (socket_->got_text() ||
        !envelope_.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())) ||
        !envelope_.has_pose()) {
      ++counts_->texts;
      return;
    }
    const double now = NowMs();
    counts_->ages.push_back(now - 1e-6 * static_cast<double>(envelope_.pose().time_ns()));
    counts_->since_sent.push_back(now - envelope_.sent_ms());
    if (counts_->poses > 0) {
      counts_->longest_gap = std::max(counts_->longest_gap, now - counts_->last_ms);
    }
    counts_->last_ms = now;
    ++counts_->poses;
    if (++unacknowledged_ >= 8 && !is_writing_) Acknowledge(envelope_.sequence());
  }

  void Acknowledge(std::uint32_t sequence) {
    unacknowledged_ = 0;
    is_writing_ = true;
    acknowledgement_ = R"({"type":"ack","sequence":)" + std::to_string(sequence) + "}";
    socket_->text(true);
    socket_->async_write(asio::buffer(acknowledgement_),
                         [this](boost::beast::error_code, std::size_t) { is_writing_ = false; });
  }

  std::unique_ptr<Socket> socket_;
  boost::beast::flat_buffer buffer_;
  palpate::v1::Envelope envelope_;  // that came last
  std::string acknowledgement_;
  int unacknowledged_ = 0;
  bool is_writing_ = false, is_lost_ = false;
  std::unique_ptr<Counts> counts_ = std::make_unique<Counts>();
};

void Run(asio::io_context& io, std::chrono::duration<double> time) {
  io.run_for(std::chrono::duration_cast<std::chrono::nanoseconds>(time));
}

// True if the server has closed it: what was sent before is read, then the end.
bool IsDropped(Socket& socket) {
  tcp::socket& tcp_socket = socket.next_layer();
  tcp_socket.non_blocking(true);
  std::vector<char> bytes(65536);
  boost::beast::error_code error;
  while (!error) tcp_socket.read_some(asio::buffer(bytes), error);
  return error != asio::error::would_block;
}

using Guests = std::vector<std::unique_ptr<LoadGuest>>;

// What the guests get within this time. What waited while they joined, or while the last report was
// made, does not count.
json Watch(asio::io_context& io, const Guests& guests, double window_s) {
  Run(io, std::chrono::seconds(1));
  for (const auto& guest : guests) guest->BeginToCount();
  const double begin_ms = NowMs();
  Run(io, std::chrono::duration<double>(window_s));
  const double seconds = (NowMs() - begin_ms) / 1e3;

  json report = {{"guests", guests.size()}, {"seconds", seconds}, {"clients", json::array()}};
  std::vector<double> p99s, poses;
  int lost = 0;
  for (const auto& guest : guests) {
    json client = guest->Report();
    lost += guest->is_lost() ? 1 : 0;
    poses.push_back(static_cast<double>(guest->poses()));
    if (!client["age_ms"].is_null()) p99s.push_back(client["age_ms"]["p99"]);
    report["clients"].push_back(std::move(client));
  }
  report["lost"] = lost;
  report["fewest_poses_a_second"] =
      poses.empty() ? 0.0 : *std::min_element(poses.begin(), poses.end()) / seconds;
  report["worst_age_p99_ms"] =
      p99s.empty() ? json() : json(*std::max_element(p99s.begin(), p99s.end()));
  return report;
}

int Main(const std::vector<std::string>& arguments) {
  if (arguments.size() < 6) {
    std::cerr << "usage: web_guests HOST PORT SECRET GUESTS SECONDS [STALLED [WINDOWS]]\n";
    return 2;
  }
  asio::io_context io;
  const Target target{
      {asio::ip::make_address(arguments[1]), static_cast<std::uint16_t>(std::stoi(arguments[2]))},
      arguments[1] + ":" + arguments[2],
      arguments[3]};
  std::vector<std::unique_ptr<Socket>> stalled;
  for (int n = arguments.size() > 6 ? std::stoi(arguments[6]) : 0; n > 0; --n) {
    stalled.push_back(Join(io, target));
  }
  Guests guests;
  for (int n = std::stoi(arguments[4]); n > 0; --n) {
    guests.push_back(std::make_unique<LoadGuest>(io, target));
    io.poll();
  }
  Run(io, std::chrono::seconds(1));
  for (int n = arguments.size() > 7 ? std::stoi(arguments[7]) : 1; n > 0; --n) {
    json report = Watch(io, guests, std::stod(arguments[5]));
    report["stalled"] = stalled.size();
    report["stalled_dropped"] = std::count_if(
        stalled.begin(), stalled.end(), [](const auto& socket) { return IsDropped(*socket); });
    std::cout << report.dump() << std::endl;
  }
  return 0;
}

}  // namespace

int main(int count, char** arguments) {
  try {
    return Main({arguments, arguments + count});
  } catch (const std::exception& error) {
    std::cerr << "web_guests: " << error.what() << "\n";
    return 1;
  }
}
