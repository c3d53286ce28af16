#include "client/web/http/messages.h"

#include <limits>
#include <nlohmann/json.hpp>

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

}  // namespace

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

std::string SteeredJson(std::uint64_t id, const std::string& error) {
  return json{{"type", "steered"}, {"id", id}, {"error", error}}.dump(
      -1, ' ', false, json::error_handler_t::replace);
}

std::optional<LoginRequest> ParseLogin(std::string_view text) {
  const json object = ParseObject(text);
  LoginRequest login{TextIn(object, "room"), TextIn(object, "token")};
  if (login.room.has_value() == login.token.has_value()) return std::nullopt;
  return login;
}

}  // namespace palpate::web
