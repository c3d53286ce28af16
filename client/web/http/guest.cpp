#include "client/web/http/guest.h"

#include <boost/asio/buffer.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/websocket/error.hpp>
#include <chrono>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>
#include <variant>
#include <vector>

#include "client/web/http/connections.h"

namespace palpate::web {
namespace {

using nlohmann::json;

json ParseObject(std::string_view text) {
  json parsed = json::parse(text, nullptr, /*allow_exceptions=*/false);
  return parsed.is_object() ? parsed : json::object();
}

template <class Number>
std::optional<Number> CountIn(const json& object, const char* key) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_number_unsigned()) return std::nullopt;
  const auto value = found->get<std::uint64_t>();
  if (value > std::numeric_limits<Number>::max()) return std::nullopt;
  return static_cast<Number>(value);
}

std::optional<std::string> TextIn(const json& object, const char* key) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_string()) return std::nullopt;
  return found->get<std::string>();
}

struct Ack {
  std::uint32_t sequence = 0;  // of the newest pose that was received
};

// Nothing: no message of the contract.
std::optional<std::variant<Ack, Steer>> ParseMessage(std::string_view text) {
  const json message = ParseObject(text);
  const std::optional<std::string> type = TextIn(message, "type");
  if (type == "ack") {
    const auto sequence = CountIn<std::uint32_t>(message, "sequence");
    if (sequence) return Ack{*sequence};
  } else if (type == "steer") {
    const auto id = CountIn<std::uint64_t>(message, "id");
    const auto key = TextIn(message, "key");
    const auto value = message.find("value");
    if (id && key && value != message.end() && value->is_number()) {
      return Steer{*id, *key, value->get<double>()};
    }
  }
  return std::nullopt;
}

// The answer to a Steer. `error`: empty if it was carried out.
std::string SteeredJson(std::uint64_t id, const std::string& error) {
  return json{{"type", "steered"}, {"id", id}, {"error", error}}.dump(
      -1, ' ', false, json::error_handler_t::replace);
}

}  // namespace

std::optional<LoginRequest> ParseLogin(std::string_view text) {
  const json object = ParseObject(text);
  LoginRequest login{TextIn(object, "room"), TextIn(object, "token")};
  if (login.room.has_value() == login.token.has_value()) return std::nullopt;
  return login;
}

namespace {

namespace asio = boost::asio;
namespace websocket = boost::beast::websocket;

// Small, so that a guest that does not read is noticed soon.
constexpr int kSendBufferBytes = 64 << 10;

}  // namespace

void PoseWindow::Sent(std::uint32_t sequence) {
  sent_.at((oldest_ + count_) % kMost) = sequence;
  ++count_;
  newest_ = sequence;
  has_sent_ = true;
}

// Numbers wrap around: the sign of a difference says which is newer.
bool PoseWindow::Acknowledge(std::uint32_t sequence) {
  if (!has_sent_ || static_cast<std::int32_t>(sequence - newest_) > 0) return false;
  while (count_ > 0 && static_cast<std::int32_t>(sequence - sent_.at(oldest_)) >= 0) {
    oldest_ = (oldest_ + 1) % kMost;
    --count_;
  }
  return true;
}

Guest::Guest(std::shared_ptr<Site> site, PeerStream stream,
             std::unique_ptr<Connections::Ticket> ticket, SessionPtr session, std::string peer)
    : site_(std::move(site)),
      socket_(std::move(stream)),
      ticket_(std::move(ticket)),
      session_(std::move(session)),
      peer_(std::move(peer)) {}

void Guest::Start(const Request& request) {
  const HttpTimeouts& timeouts = site_->options.timeouts;
  MakeRoom();
  site_->guests.push_back(this);
  ticket_->use = Connections::Ticket::Use::kWebSocket;
  write_began_ = site_->now;
  ticket_->close = [weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->End("stop");
  };
  PeerStream& peer = socket_.next_layer();
  peer.tcp().expires_never();
  peer.tcp().rate_policy().Set(kMostBytes);
  ErrorCode ignored;
  peer.tcp().socket().set_option(asio::socket_base::send_buffer_size(kSendBufferBytes), ignored);
  // With pings, so that a guest whose network is gone is noticed where no poses flow.
  socket_.set_option(websocket::stream_base::timeout{timeouts.request, timeouts.keep_alive, true});
  socket_.set_option(websocket::stream_base::decorator(
      [](websocket::response_type& response) { AddProtection(response); }));
  socket_.control_callback(
      [this](websocket::frame_type, boost::beast::string_view) { ++messages_; });
  socket_.auto_fragment(false);
  socket_.read_message_max(kMaxMessageBytes);
  socket_.async_accept(request,
                       [self = shared_from_this()](ErrorCode error) { self->OnJoined(error); });
}

bool Guest::IsFull(const Site& site) {
  return static_cast<int>(site.guests.size()) >= site.options.max_guests;
}

Guest* Guest::WhoGivesWayTo(const Session& session, const Site& site) {
  std::vector<std::string_view> networks;
  for (const Guest* guest : site.guests) networks.push_back(guest->session_->network);
  const auto guest = WhoGivesWay(std::move(networks), session.network);
  return guest ? site.guests[*guest] : nullptr;
}

// Ends the session's oldest guest if there are as many as may be, or who gives way in a full house.
// Without goodbye: one that waits for an answer would hold a socket.
void Guest::MakeRoom() {
  std::vector<Guest*> others = site_->guests;
  std::erase_if(others, [&](const Guest* other) { return other->session_ != session_; });
  if (others.size() >= kMostOfASession) {
    site_->log.Refused("tabs", peer_ + ": " + session_->user + ": too many tabs", site_->now);
    others.front()->End("tabs");
  }
  Guest* const other = IsFull(*site_) ? WhoGivesWayTo(*session_, *site_) : nullptr;
  if (other == nullptr) return;
  site_->log.Refused("full", other->peer_ + ": " + other->session_->user + ": gives way",
                     site_->now);
  other->End("full");
}

void Guest::OnJoined(ErrorCode error) {
  if (state_ != State::kJoining) return;
  if (error) return End("malformed");
  state_ = State::kOpen;
  if (site_->events.joined) site_->events.joined();
  texts_.push_back(
      std::make_shared<const std::string>(site_->hub.hello(session_->user, session_->may_steer)));
  for (int n = 0; n < kTopics; ++n) due_[n] = site_->hub.Newest(static_cast<Topic>(n)) != nullptr;
  pose_due_ = site_->hub.pose() != nullptr;
  site_->hub.Subscribe(this);
  Read();
  Write();
}

void Guest::OnTopic(Topic topic) {
  due_.set(static_cast<std::size_t>(topic));
  // One who joins again and again would cost a message to everybody each time.
  if (topic != Topic::kGuests) Write();
}

void Guest::OnPose() {
  if (pose_due_ && site_->events.skipped) site_->events.skipped();
  pose_due_ = true;
  Write();
}

void Guest::Read() {
  socket_.async_read(incoming_, [self = shared_from_this()](ErrorCode error, std::size_t) {
    self->OnMessage(error);
  });
}

void Guest::OnMessage(ErrorCode error) {
  if (state_ != State::kOpen) return;
  if (error) {
    const bool is_broken =
        error.category() == make_error_code(websocket::error::closed).category() &&
        error != websocket::error::closed;
    if (!is_broken) return End("");
    site_->log.Refused("malformed", peer_ + ": " + session_->user + ": " + error.message(),
                       site_->now);
    return End("malformed");
  }
  const auto bytes = incoming_.data();
  const std::string_view text(static_cast<const char*>(bytes.data()), bytes.size());
  if (++messages_ > kMostMessages) return Leave("flood", "too many messages");
  if (!socket_.got_text() || !Obey(text)) return Leave("malformed", "not a message of this site");
  incoming_.clear();
  Read();
}

bool Guest::Obey(std::string_view text) {
  const auto message = ParseMessage(text);
  if (!message) return false;
  if (const auto* steer = std::get_if<Steer>(&*message)) {
    ObeySteer(*steer);
    return true;
  }
  if (!window_.Acknowledge(std::get<Ack>(*message).sequence)) return false;
  if (!window_.IsFull()) window_full_.reset();
  Write();
  return true;
}

void Guest::ObeySteer(const Steer& steer) {
  const std::string refusal = site_->access.SteeringRefusal(*session_, steer.key, steer.value,
                                                            std::chrono::steady_clock::now());
  if (!refusal.empty()) {
    site_->log.Refused("steering", peer_ + ": " + session_->user + ": " + refusal, site_->now);
    return Answer(steer.id, refusal);
  }
  site_->hub.steer({session_->user, steer.key, steer.value},
                   [weak = weak_from_this(), id = steer.id](const std::string& error) {
                     if (const auto self = weak.lock()) self->Answer(id, error);
                   });
}

void Guest::Answer(std::uint64_t id, const std::string& error) {
  if (state_ != State::kOpen) return;
  texts_.push_back(std::make_shared<const std::string>(SteeredJson(id, error)));
  Write();
}

void Guest::Write() {
  if (writing_ || state_ != State::kOpen) return;
  bool is_text = true;
  writing_ = TakeNext(is_text);
  if (!writing_) return;
  socket_.text(is_text);
  write_began_ = site_->now;
  socket_.async_write(
      asio::buffer(*writing_),
      [self = shared_from_this()](ErrorCode error, std::size_t) { self->OnWritten(error); });
}

// Poses come last: they come again.
Body Guest::TakeNext(bool& is_text) {
  if (!texts_.empty()) {
    Body text = std::move(texts_.front());
    texts_.pop_front();
    return text;
  }
  for (int n = 0; due_.any() && n < kTopics; ++n) {
    if (!due_[n]) continue;
    due_.reset(n);
    is_text = !FactOf(static_cast<Topic>(n));
    return site_->hub.Newest(static_cast<Topic>(n));
  }
  if (!pose_due_) return nullptr;
  if (window_.IsFull()) {
    if (!window_full_) window_full_ = site_->now;
    return nullptr;
  }
  pose_due_ = false;
  is_text = false;
  window_.Sent(site_->hub.pose_sequence());
  return site_->hub.pose();
}

void Guest::OnWritten(ErrorCode error) {
  const std::size_t bytes = writing_->size();
  writing_.reset();
  if (state_ != State::kOpen) return;
  if (error) return End("");
  if (site_->events.streamed) site_->events.streamed(bytes);
  Write();
}

void Guest::Check() {
  const HttpTimeouts& timeouts = site_->options.timeouts;
  const Time now = site_->now;
  const bool waits = writing_ != nullptr || state_ != State::kOpen;
  if (waits && now - write_began_ > timeouts.write) {
    return state_ == State::kLeaving ? End(left_for_) : Drop("messages are not read");
  }
  if (state_ != State::kOpen) return;
  if (window_full_ && now - *window_full_ > timeouts.acknowledge) {
    return Drop("poses are not acknowledged");
  }
  if (session_->IsOver(now)) return Leave("session", "the session is over: log in again");
  ReadBudget& budget = socket_.next_layer().tcp().rate_policy();
  if (messages_ > kMostMessages || budget.IsUsedUp()) return Leave("flood", "too many messages");
  messages_ = 0;
  budget.Set(kMostBytes);
  Write();
}

std::size_t Guest::held_bytes() const {
  std::size_t bytes = writing_ ? writing_->size() : 0;
  for (const Body& text : texts_) bytes += text->size();
  return bytes;
}

void Guest::Leave(std::string_view kind, const char* why) {
  if (state_ != State::kOpen) return;
  site_->log.Refused(kind, peer_ + ": " + session_->user + ": " + why, site_->now);
  site_->hub.Unsubscribe(this);
  state_ = State::kLeaving;
  left_for_ = kind;
  texts_.clear();
  write_began_ = site_->now;
  socket_.async_close({websocket::close_code::policy_error, why},
                      [self = shared_from_this()](ErrorCode) { self->End(self->left_for_); });
}

// Without goodbye, which a guest that does not read would not read.
void Guest::Drop(const char* why) {
  site_->log.Refused("slow", peer_ + ": " + session_->user + ": " + why, site_->now);
  End("slow");
}

void Guest::End(std::string_view kind) {
  if (state_ == State::kEnded) return;
  const bool had_joined = state_ != State::kJoining;
  if (state_ == State::kOpen) site_->hub.Unsubscribe(this);
  state_ = State::kEnded;
  std::erase(site_->guests, this);
  ticket_.reset();
  socket_.next_layer().Close();
  if (had_joined && site_->events.left) site_->events.left(kind);
}

}  // namespace palpate::web
