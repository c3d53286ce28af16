#include "server/device/haply/inverse_messages.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "common/error/one_line.h"

namespace palpate {
namespace {

using Json = nlohmann::json;

// An id is written into messages.
constexpr std::size_t kMostIdBytes = 64;
constexpr double kSame = 1e-6;
constexpr double kUnit = 0.01;

// Throws what Json throws, which ParseInverse takes for a bad reply.
Vec3 TripleOf(const Json& json) {
  return {json.at("x").get<double>(), json.at("y").get<double>(), json.at("z").get<double>()};
}

Eigen::Quaterniond RotationOf(const Json& json) {
  return {json.at("w").get<double>(), json.at("x").get<double>(), json.at("y").get<double>(),
          json.at("z").get<double>()};
}

std::optional<Json> Parsed(std::string_view text) {
  Json json = Json::parse(text, nullptr, false);
  if (json.is_discarded() || !json.is_object()) return std::nullopt;
  return json;
}

std::string IdOf(const Json& device) {
  std::string id = device.at("device_id").get<std::string>();
  const bool is_plain =
      !id.empty() && id.size() <= kMostIdBytes && std::ranges::all_of(id, [](unsigned char c) {
        return std::isalnum(c) != 0 || c == '-' || c == '_' || c == '.';
      });
  if (!is_plain) throw Json::other_error::create(501, "a strange device_id", &device);
  return id;
}

bool IsOne(const Json& scale) {
  const auto is_one = [](const Json& n) { return std::abs(n.get<double>() - 1.0) < kSame; };
  if (scale.is_number()) return is_one(scale);
  return is_one(scale.at("x")) && is_one(scale.at("y")) && is_one(scale.at("z"));
}

// A part that is missing is as it was made.
bool IsIdentity(const Json& transform) {
  if (transform.contains("position") && TripleOf(transform["position"]).norm() > kSame)
    return false;
  if (transform.contains("rotation") &&
      std::abs(std::abs(RotationOf(transform["rotation"]).w()) - 1.0) > kSame) {
    return false;
  }
  return !transform.contains("scale") || IsOne(transform["scale"]);
}

InversePlacing PlacingOf(const Json& device) {
  const auto foreign = [](const char* what) { return InversePlacing{false, what}; };
  const Json& state = device.at("state");
  if (state.contains("transform") && !IsIdentity(state["transform"])) return foreign("transform");
  if (!device.contains("config")) return {};
  const Json& config = device["config"];
  if (config.contains("mount") && !IsIdentity(config["mount"])) return foreign("mount");
  const Json basis = config.value("basis", Json::object()).value("permutation", Json("XYZ"));
  if (basis != "XYZ") return foreign("basis");
  const Json filters = config.value("filters", Json::object());
  const Json damping = filters.value("damping", Json::object()).value("scalar", Json(0.0));
  if (std::abs(damping.get<double>()) > kSame) return foreign("damping");
  return {};
}

std::string MissingOf(const Json& status) {
  for (const char* flag : {"power_supply", "started", "ready", "calibrated"}) {
    if (status.contains(flag) && !status[flag].get<bool>()) return flag;
  }
  return "";
}

std::string AboutOf(const Json& config) {
  std::string about;
  const auto add = [&](const std::string& text) { about += (about.empty() ? "" : ", ") + text; };
  const auto text_of = [&](const char* key) {
    return config.contains(key) ? OneLine(config[key].is_string() ? config[key].get<std::string>()
                                                                  : config[key].dump())
                                : std::string();
  };
  if (const std::string version = text_of("extended_firmware_version"); !version.empty()) {
    add("firmware " + version);
  }
  if (const std::string hand = text_of("handedness"); !hand.empty()) add(hand + "-handed");
  for (const char* key : {"gravity_compensation", "torque_scaling"}) {
    if (!config.contains(key)) continue;
    std::string name = key;
    name[name.find('_')] = ' ';
    add(name + (config[key].at("enabled").get<bool>() ? " on" : " off"));
  }
  const Json gate = config.value("filters", Json::object()).value("force_gate", Json::object());
  if (gate.contains("gain")) add(fmt::format("force gate {:g}", gate["gain"].get<double>()));
  return about;
}

InverseArm ArmOf(const Json& device) {
  const Json& state = device.at("state");
  InverseArm arm{.id = IdOf(device), .cursor_m = TripleOf(state.at("cursor_position"))};
  if (state.contains("current_cursor_force")) arm.felt_n = TripleOf(state["current_cursor_force"]);
  for (const char* key : {"mode", "control_mode"}) {
    if (state.contains(key)) arm.mode = state[key].get<std::string>();
  }
  const Json status = device.value("status", Json::object());
  arm.missing = MissingOf(status);
  arm.is_in_use = status.value("in_use", false);
  arm.placing = PlacingOf(device);
  if (device.contains("config")) {
    arm.type = device["config"].value("type", std::string());
    arm.about = AboutOf(device["config"]);
  }
  return arm;
}

InverseGrip GripOf(const Json& device, const char* family) {
  const Json& state = device.at("state");
  InverseGrip grip{
      .id = IdOf(device), .family = family, .orientation = RotationOf(state.at("orientation"))};
  if (!(std::abs(grip.orientation.norm() - 1.0) < kUnit)) {
    throw Json::other_error::create(501, "an orientation that is none", &device);
  }
  grip.orientation.normalize();
  if (state.contains("button")) grip.buttons = state["button"].get<bool>() ? 1u : 0u;
  std::uint32_t bit = 1;
  for (const char* key : {"a", "b", "c"}) {
    if (state.value("buttons", Json::object()).value(key, false)) grip.buttons |= bit;
    bit <<= 1;
  }
  const Json status = device.value("status", Json::object());
  for (const char* flag : {"connected", "awake", "ready"}) {
    grip.is_awake = grip.is_awake && status.value(flag, true);
  }
  return grip;
}

}  // namespace

std::optional<InverseReply> ParseInverse(std::string_view text) {
  try {
    const std::optional<Json> json = Parsed(text);
    if (!json) return std::nullopt;
    InverseReply reply;
    for (const Json& device : json->value("inverse3", Json::array())) {
      reply.arms.push_back(ArmOf(device));
    }
    for (const char* family : {"verse_grip", "wireless_verse_grip", "custom_verse_grip"}) {
      for (const Json& device : json->value(family, Json::array())) {
        reply.grips.push_back(GripOf(device, family));
      }
    }
    return reply;
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

std::optional<std::array<int, 2>> ParseInverseVersion(std::string_view text) {
  try {
    const std::optional<Json> json = Parsed(text);
    std::array<int, 2> version{};
    if (!json) return std::nullopt;
    const std::string words = json->at("project_version").get<std::string>();
    if (std::sscanf(words.c_str(), "%d.%d", &version[0], &version[1]) != 2) return std::nullopt;
    return version;
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

// The form of the answer is not written: a number, or an object with one.
std::optional<double> ParseInverseForceScale(std::string_view text) {
  const Json json = Json::parse(text, nullptr, false);
  if (json.is_number()) return json.get<double>();
  if (!json.is_object()) return std::nullopt;
  for (const char* key : {"force_scale", "value"}) {
    if (json.contains(key) && json[key].is_number()) return json[key].get<double>();
  }
  return std::nullopt;
}

std::optional<InverseEvent> ParseInverseEvent(std::string_view text) {
  try {
    const std::optional<Json> json = Parsed(text);
    if (!json) return std::nullopt;
    const std::string name = json->at("name").get<std::string>();
    const Json data = json->value("data", Json::object());
    const std::string safety = data.value("safety_type", std::string());
    InverseEvent event;
    event.ends_force = safety == "ebrake_triggered" || safety == "stall_detected";
    const std::string level = json->value("level", std::string());
    if (event.ends_force || level == "warning" || level == "error" || level == "critical") {
      event.text = OneLine(name + (safety.empty() ? "" : ", " + safety) + ": " +
                           json->value("message", std::string()));
    }
    return event;
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

std::string InverseSetUp(std::string_view arm) {
  const Json zero = {{"x", 0.0}, {"y", 0.0}, {"z", 0.0}};
  const Json ones = {{"x", 1.0}, {"y", 1.0}, {"z", 1.0}};
  const Json transform = {{"position", zero},
                          {"rotation", {{"w", 1.0}, {"x", 0.0}, {"y", 0.0}, {"z", 0.0}}},
                          {"scale", ones}};
  const Json configure = {{"basis", {{"permutation", "XYZ"}}},
                          {"mount", {{"transform", transform}}},
                          {"damping", {{"scalar", 0.0}}}};
  const Json device = {{"device_id", std::string(arm)},
                       {"configure", configure},
                       {"commands", {{"probe_position", Json::object()}}}};
  return Json({{"session",
                {{"configure", {{"profile", {{"name", "org.palpate:palpated"}}}}},
                 {"force_render_full_state", Json::object()}}},
               {"inverse3", Json::array({device})}})
      .dump();
}

std::string_view InverseWriter::Write(const InverseCommand& command) noexcept {
  char* end = text_.data();
  const auto add = [&](fmt::format_string<> text) { end = fmt::format_to(end, text); };
  add("{{");
  if (command.wants_full_state) add(R"("session":{{"force_render_full_state":{{}}}},)");
  end = fmt::format_to(end, R"("inverse3":[{{"device_id":"{}","commands":{{)", arm_);
  if (command.force_n) {
    end = fmt::format_to(end, R"("set_cursor_force":{{"{}":{{"x":{:.4f},"y":{:.4f},"z":{:.4f}}}}})",
                         command.is_before_3_5 ? "values" : "vector", command.force_n->x(),
                         command.force_n->y(), command.force_n->z());
  } else {
    add(R"("probe_position":{{}})");
  }
  add("}}}}]");
  // A grip that does not belong to this arm needs a question of its own.
  if (!grip_.empty()) {
    end = fmt::format_to(end,
                         R"(,"{}":[{{"device_id":"{}","commands":{{"probe_orientation":{{}}}}}}])",
                         grip_family_, grip_);
  }
  add("}}");
  return {text_.data(), static_cast<std::size_t>(end - text_.data())};
}

}  // namespace palpate
