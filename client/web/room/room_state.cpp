#include "client/web/room/room_state.h"

#include <nlohmann/json.hpp>

#include "client/web/upstream/topic_text.h"

namespace palpate::web {
namespace {

using client::ConnectionState;
using nlohmann::json;

std::string TextAt(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
}

std::optional<ConnectionState> StateOf(std::string_view name) {
  if (name == "connecting") return ConnectionState::kConnecting;
  if (name == "connected") return ConnectionState::kConnected;
  if (name == "lost") return ConnectionState::kLost;
  return std::nullopt;
}

}  // namespace

void RoomState::TakeLink(bool is_connected, Time now) {
  if (is_connected != is_connected_) since_ = now;
  is_connected_ = is_connected;
  was_connected_ = was_connected_ || is_connected;
}

void RoomState::TakeBeat(const Beat& beat, Time now) {
  const bool is_known = beat.protocol == kRoomProtocol;
  if (is_known && !is_published(now)) published_since_ = now;
  (is_known ? heard_ : heard_other_) = now;
  if (is_known) shares_clock_ = beat.machine == machine_;
}

void RoomState::TakeText(std::string_view text) {
  const json object = json::parse(text, nullptr, false);
  if (!object.is_object()) return;
  const std::optional<ConnectionState> state = StateOf(TextAt(object, "state"));
  if (!state) return;
  word_ = Connection{*state, PlainWhy(*state), TextAt(object, "palpated")};
  const std::string why = TextAt(object, "why");
  if (*state != ConnectionState::kConnected && !why.empty()) word_->why = why;
}

void RoomState::TakeCopyText(std::string_view text) {
  const json object = json::parse(text, nullptr, false);
  if (!object.is_object()) return;
  const auto loading = object.find("loading");
  const bool is_loading = loading != object.end() && *loading == json(true);
  volume_ = {TextAt(object, "problem"), is_loading};
}

RoomState::Volume RoomState::volume() const {
  return has_volume_link_ ? volume_ : Volume{"NATS is not reached", false};
}

std::string RoomState::MissingVolume() const {
  const Volume now = volume();
  if (now.is_loading) return "palpated loads it";
  return now.problem.empty() && !has_volume_ ? "the room has none yet" : now.problem;
}

bool RoomState::is_published(Time now) const {
  // A beat of before the link was lost says nothing of a server that was started anew.
  return is_connected_ && heard_ && *heard_ >= since_ && now - *heard_ < kBeatLife;
}

RoomState::Connection RoomState::At(Time now) const {
  const std::string palpated = word_ ? word_->palpated : std::string();
  const Connection connecting{ConnectionState::kConnecting, "connecting to the room", palpated};
  // The server does not take what the publisher puts, or does not answer.
  const Connection silent{ConnectionState::kConnecting, "the room keeps nothing yet", palpated};
  const auto lost = [&](const char* why) {
    return Connection{ConnectionState::kLost, why, palpated};
  };
  const bool is_new = now - since_ < kBeatLife;
  if (!is_connected_) {
    return is_new && !was_connected_ ? connecting : lost("NATS is not reached");
  }
  if (is_published(now)) {
    const bool is_late = now - published_since_ >= kBeatLife;
    return word_.value_or(is_late ? silent : connecting);
  }
  if (heard_other_ && *heard_other_ >= since_ && now - *heard_other_ < kBeatLife) {
    return lost("the room's publisher is another version");
  }
  return is_new ? connecting : lost("nobody publishes this room");
}

}  // namespace palpate::web
