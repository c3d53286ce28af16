#include "client/web/upstream/topic_text.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <variant>

#include "common/error/text.h"

namespace palpate::web {
namespace {

using Json = nlohmann::ordered_json;
using client::Setting;

std::string Dump(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Json ToJson(const Setting& setting) {
  Json json{{"key", setting.key},   {"label", setting.label}, {"unit", setting.unit},
            {"help", setting.help}, {"kind", "flag"},         {"minimum", nullptr},
            {"maximum", nullptr},   {"whole", false},         {"words", Json::array()}};
  if (const auto* number = std::get_if<client::NumberSetting>(&setting.kind)) {
    json["kind"] = "number";
    json["whole"] = number->whole;
    if (std::isfinite(number->minimum)) json["minimum"] = number->minimum;
    if (std::isfinite(number->maximum)) json["maximum"] = number->maximum;
  } else if (const auto* choice = std::get_if<client::ChoiceSetting>(&setting.kind)) {
    json["kind"] = "choice";
    for (const std::string_view word : choice->words) json["words"].push_back(word);
  }
  return json;
}

// Stores a value in an update. Returns false if it is none of the setting's.
struct Store {
  double value;
  client::SettingsUpdate& update;

  bool operator()(const client::NumberSetting& number) const {
    update.*number.update = value;
    return std::isfinite(value);
  }
  bool operator()(const client::FlagSetting& flag) const {
    update.*flag.update = value == 1.0;
    return value == 0.0 || value == 1.0;
  }
  bool operator()(const client::ChoiceSetting& choice) const {
    for (std::size_t place = 0; place < choice.words.size(); ++place) {
      if (value != static_cast<double>(place)) continue;
      choice.update(update, place);
      return true;
    }
    return false;
  }
};

std::string_view NameOf(client::ConnectionState state) {
  switch (state) {
    case client::ConnectionState::kConnecting:
      return "connecting";
    case client::ConnectionState::kConnected:
      return "connected";
    case client::ConnectionState::kLost:
      break;
  }
  return "lost";
}

}  // namespace

std::string HelloText(const HelloInfo& info) {
  Json settings = Json::array();
  for (const Setting& setting : client::kSettings) {
    const bool may = std::find(info.may_steer.begin(), info.may_steer.end(), setting.key) !=
                     info.may_steer.end();
    if (may || setting.key == client::kIsovalue.key) settings.push_back(ToJson(setting));
  }
  return Dump({{"type", "hello"},
               {"protocol", 2},
               {"version", info.version},
               {"user", info.user},
               {"may_steer", info.may_steer},
               {"may_stop", info.may_stop},
               {"settings", settings},
               {"server_time_ms", info.server_time_ms}});
}

std::string PlainWhy(client::ConnectionState state) {
  switch (state) {
    case client::ConnectionState::kConnected:
      return "";
    case client::ConnectionState::kConnecting:
      return "connecting to palpated";
    case client::ConnectionState::kLost:
      break;
  }
  return "palpated is not reached";
}

std::string PlainProblem(const client::VolumeStatus& status) {
  if (status.is_loading || status.problem.empty()) return status.problem;
  return "palpated sends no voxels";
}

std::string PlainRefusal(const Error& refusal) {
  switch (refusal.kind()) {
    case ErrorKind::kInvalidArgument:
      return refusal.what();
    case ErrorKind::kPermissionDenied:
      return "palpated does not let the gateway change settings";
    case ErrorKind::kUnavailable:
      return "palpated is not reached";
    default:
      return "palpated does not take it now";
  }
}

std::string ConnectionText(client::ConnectionState state, const std::string& why,
                           const std::string& palpated, std::int64_t since_ms) {
  return Dump({{"type", "connection"},
               {"state", NameOf(state)},
               {"why", OneLine(why)},
               {"palpated", OneLine(palpated)},
               {"since_ms", since_ms}});
}

std::string CopyText(std::uint64_t bricks_left, const std::string& problem, bool is_loading) {
  return Dump({{"type", "copy"},
               {"bricks_left", bricks_left},
               {"problem", OneLine(problem)},
               {"loading", is_loading}});
}

std::string ManifestText(const ManifestInfo& manifest) {
  return Dump({{"type", "manifest"},
               {"name", manifest.name},
               {"revision", manifest.revision.volume_revision},
               {"complete", true}});
}

std::string SteeringText(const std::deque<SteeredChange>& changes) {
  Json list = Json::array();
  for (const SteeredChange& change : changes) {
    list.push_back({{"user", change.user},
                    {"key", change.key},
                    {"value", change.value},
                    {"time_ms", change.time_ms}});
  }
  return Dump({{"type", "steering"}, {"changes", list}});
}

std::optional<client::SettingsUpdate> UpdateOf(const std::string& key, double value) {
  client::SettingsUpdate update;
  for (const Setting& setting : client::kSettings) {
    if (setting.key == key && std::visit(Store{value, update}, setting.kind)) return update;
  }
  return std::nullopt;
}

std::optional<client::PatientFacing> FacingOf(const std::string& key, double value) {
  if (key != client::kFacingKey) return std::nullopt;
  if (!(value >= 0.0 && value < client::kFacings)) return std::nullopt;
  const auto number = static_cast<std::size_t>(value);
  return client::PatientFacing{client::kWorldDirections[number / 6],
                               client::kWorldDirections[number % 6]};
}

}  // namespace palpate::web
