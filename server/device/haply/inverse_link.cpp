#include "server/device/haply/inverse_link.h"

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <deque>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/error/text.h"
#include "server/realtime/tick_timer.h"

namespace palpate {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMostIdBytes = 64;  // it is written into messages
constexpr std::size_t kMostTextBytes = 200;
constexpr int kMostDepth = 16;
constexpr std::size_t kMostDevices = 16;  // of a family
constexpr double kSame = 1e-6;
constexpr double kUnit = 0.01;
constexpr double kMost_m = 10.0;

// Thrown, as Json::exception is, for a value that is not as documented.
struct Strange {};

// Reading deeply nested text would need a deep stack.
bool IsFlat(std::string_view text) {
  int depth = 0;
  bool is_quoted = false;
  for (std::size_t n = 0; n < text.size(); ++n) {
    const char c = text[n];
    if (is_quoted && c == '\\') ++n;
    if (c == '"') is_quoted = !is_quoted;
    if (is_quoted) continue;
    if (c == '{' || c == '[') ++depth;
    if (c == '}' || c == ']') --depth;
    if (depth > kMostDepth) return false;
  }
  return true;
}

Json Parsed(std::string_view text) {
  return IsFlat(text) ? Json::parse(text, nullptr, false) : Json(Json::value_t::discarded);
}

// A part that may be missing: an object without members then.
const Json& Part(const Json& json, const char* key) {
  static const Json kNone = Json::object();
  if (!json.is_object()) throw Strange();
  const auto part = json.find(key);
  return part == json.end() ? kNone : *part;
}

std::string TextOf(const Json& json, const char* key) {
  const Json& part = Part(json, key);
  if (!part.is_string()) return "";
  // Cut, it may end within a character.
  return Utf8(OneLine(part.get<std::string>()).substr(0, kMostTextBytes));
}

bool FlagOf(const Json& json, const char* key, bool otherwise) {
  return json.contains(key) ? json[key].get<bool>() : otherwise;
}

Vec3 TripleOf(const Json& json) {
  return {json.at("x").get<double>(), json.at("y").get<double>(), json.at("z").get<double>()};
}

Eigen::Quaterniond RotationOf(const Json& json) {
  return {json.at("w").get<double>(), json.at("x").get<double>(), json.at("y").get<double>(),
          json.at("z").get<double>()};
}

// Names of devices and kinds.
std::string NameOf(const Json& json) {
  const std::string name = json.get<std::string>();
  const bool is_plain = !name.empty() && name.size() <= kMostIdBytes &&
                        std::ranges::all_of(name, [](unsigned char c) {
                          return std::isalnum(c) != 0 || c == '-' || c == '_' || c == '.';
                        });
  if (!is_plain) throw Strange();
  return name;
}

bool IsOne(const Json& scale) {
  const auto is_one = [](const Json& n) { return std::abs(n.get<double>() - 1.0) < kSame; };
  if (scale.is_number()) return is_one(scale);
  return is_one(scale.at("x")) && is_one(scale.at("y")) && is_one(scale.at("z"));
}

// Where a device or what it shows is put. A part that is missing is as it was made.
const Json& TransformOf(const Json& placing) {
  const Json& inner = Part(placing, "transform");
  return inner.empty() ? placing : inner;
}

bool IsIdentity(const Json& placing) {
  const Json& transform = TransformOf(placing);
  const Json& position = Part(transform, "position");
  const Json& rotation = Part(transform, "rotation");
  const Json& scale = Part(transform, "scale");
  const auto is_turned = [](const Eigen::Quaterniond& q) {
    return q.vec().norm() > kSame || std::abs(q.norm() - 1.0) > kUnit;
  };
  return (position.empty() || TripleOf(position).norm() < kSame) &&
         (rotation.empty() || !is_turned(RotationOf(rotation))) &&
         ((scale.is_object() && scale.empty()) || IsOne(scale));
}

// Of basis, mount and filters, all that palpated sets.
bool TellsPlacing(const Json& config) {
  const Json& mount = TransformOf(Part(config, "mount"));
  return Part(Part(config, "basis"), "permutation").is_string() && mount.contains("position") &&
         mount.contains("rotation") && mount.contains("scale") &&
         Part(Part(Part(config, "filters"), "damping"), "scalar").is_number();
}

// "": as palpated sets it. Else what is not.
const char* ForeignOf(const Json& device) {
  const Json& config = Part(device, "config");
  const Json& basis = Part(Part(config, "basis"), "permutation");
  const Json& damping = Part(Part(Part(config, "filters"), "damping"), "scalar");
  if (!IsIdentity(Part(device.at("state"), "transform"))) return "transform";
  if (!IsIdentity(Part(config, "mount"))) return "mount";
  if (!basis.empty() && basis != "XYZ") return "basis";
  if (!damping.empty() && std::abs(damping.get<double>()) > kSame) return "damping";
  return "";
}

std::string MissingOf(const Json& status) {
  for (const char* flag : {"power_supply", "started", "ready", "calibrated"}) {
    if (!FlagOf(status, flag, true)) return flag;
  }
  return "";
}

std::string AboutOf(const Json& config) {
  std::string about;
  const auto add = [&](const std::string& text) { about += (about.empty() ? "" : ", ") + text; };
  const std::string version = TextOf(config, "extended_firmware_version");
  const std::string hand = TextOf(config, "handedness");
  if (!version.empty()) add("firmware " + version);
  if (!hand.empty()) add(hand + "-handed");
  for (const char* key : {"gravity_compensation", "torque_scaling"}) {
    if (Part(config, key).empty()) continue;
    std::string name = key;
    name[name.find('_')] = ' ';
    add(name + (FlagOf(Part(config, key), "enabled", false) ? " on" : " off"));
  }
  const Json& gain = Part(Part(Part(config, "filters"), "force_gate"), "gain");
  if (gain.is_number()) add(fmt::format("force gate {:g}", gain.get<double>()));
  return about;
}

InverseArm ArmOf(const Json& device) {
  const Json& state = device.at("state");
  InverseArm arm{.id = NameOf(device.at("device_id")),
                 .cursor_m = TripleOf(state.at("cursor_position"))};
  if (!(arm.cursor_m.norm() < kMost_m)) throw Strange();
  const Json& felt = Part(state, "current_cursor_force");
  if (!felt.empty()) arm.felt_n = TripleOf(felt);
  arm.mode = TextOf(state, "control_mode");
  if (arm.mode.empty()) arm.mode = TextOf(state, "mode");
  const Json& status = Part(device, "status");
  arm.missing = MissingOf(status);
  arm.is_in_use = FlagOf(status, "in_use", false);
  arm.foreign = ForeignOf(device);
  const Json& config = Part(device, "config");
  if (config.empty()) return arm;
  arm.config = InverseConfig{.type = config.contains("type") ? NameOf(config["type"]) : "",
                             .about = AboutOf(config),
                             .tells_placing = TellsPlacing(config)};
  return arm;
}

InverseGrip GripOf(const Json& device, const char* family) {
  const Json& state = device.at("state");
  InverseGrip grip{.id = NameOf(device.at("device_id")),
                   .family = family,
                   .orientation = RotationOf(state.at("orientation"))};
  if (!(std::abs(grip.orientation.norm() - 1.0) < kUnit)) throw Strange();
  grip.orientation.normalize();
  if (FlagOf(state, "button", false)) grip.buttons = 1;
  std::uint32_t bit = 1;
  for (const char* key : {"a", "b", "c"}) {
    if (FlagOf(Part(state, "buttons"), key, false)) grip.buttons |= bit;
    bit <<= 1;
  }
  const Json& status = Part(device, "status");
  for (const char* flag : {"connected", "awake", "ready"}) {
    grip.is_awake = grip.is_awake && FlagOf(status, flag, true);
  }
  return grip;
}

// The devices of a family, each by itself: what is strange about one is not the others'. Returns
// false if there was a strange one.
template <class Device, class Read>
bool Take(const Json& json, const char* family, std::vector<Device>& devices, const Read& read) {
  bool all_well = true;
  const Json& list = Part(json, family);
  for (const Json& device : list) {
    try {
      devices.push_back(read(device));
    } catch (const Json::exception&) {
      all_well = false;
    } catch (const Strange&) {
      all_well = false;
    }
  }
  return all_well;
}

}  // namespace

std::optional<InverseReply> ParseInverse(std::string_view text) {
  const Json json = Parsed(text);
  if (!json.is_object()) return std::nullopt;
  for (const Json& family : json) {
    if (family.is_structured() && family.size() > kMostDevices) return std::nullopt;
  }
  InverseReply reply;
  reply.has_strange_arm = !Take(json, "inverse3", reply.arms, ArmOf);
  for (const char* family : {"verse_grip", "wireless_verse_grip", "custom_verse_grip"}) {
    Take(json, family, reply.grips, [&](const Json& device) { return GripOf(device, family); });
  }
  return reply;
}

std::optional<std::array<int, 2>> ParseInverseVersion(std::string_view text) {
  const Json json = Parsed(text);
  std::array<int, 2> version{};
  if (!json.is_object()) return std::nullopt;
  const std::string words = TextOf(json, "project_version");
  if (std::sscanf(words.c_str(), "%d.%d", &version[0], &version[1]) != 2) return std::nullopt;
  return version;
}

// The form of the answer is not written: a number, or an object with one.
std::optional<double> ParseInverseForceScale(std::string_view text) {
  const Json json = Parsed(text);
  if (json.is_number()) return json.get<double>();
  if (!json.is_object()) return std::nullopt;
  for (const char* key : {"force_scale", "value"}) {
    if (Part(json, key).is_number()) return Part(json, key).get<double>();
  }
  return std::nullopt;
}

std::optional<InverseEvent> ParseInverseEvent(std::string_view text) {
  const Json json = Parsed(text);
  if (!json.is_object()) return std::nullopt;
  const Json& data = Part(json, "data").is_object() ? Part(json, "data") : Json::object();
  const std::string safety = TextOf(data, "safety_type"), level = TextOf(json, "level");
  InverseEvent event{.arm = TextOf(data, "device_id")};
  event.frees = safety == "ebrake_released";
  event.ends_force = safety == "ebrake_triggered" || safety == "stall_detected";
  if (event.ends_force || level == "warning" || level == "error" || level == "critical") {
    event.text = TextOf(json, "name") + (safety.empty() ? "" : ", " + safety) + ": " +
                 TextOf(json, "message");
  }
  return event;
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

namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using Clock = std::chrono::steady_clock;
using std::chrono::microseconds;
using std::chrono::milliseconds;
using ErrorCode = boost::system::error_code;
using WebSocket = beast::websocket::stream<beast::tcp_stream>;

constexpr milliseconds kLook{20};
// A peer that sends without end must not keep the thread in its handlers.
constexpr int kMostHandlers = 256;

asio::ip::tcp::endpoint Loopback(std::uint16_t port) {
  return {asio::ip::address_v4::loopback(), port};
}

// Runs an operation that was begun until it has ended. Returns false at `end` or `stop`.
bool Finish(asio::io_context& context, const bool& is_done, Clock::time_point end,
            const std::atomic<bool>& stop) {
  context.restart();
  while (!is_done && !stop && Clock::now() < end) {
    context.run_one_for(kLook);
    context.restart();
  }
  return is_done;
}

// A connected WebSocket, which collects its messages.
class Line {
 public:
  // is_asked: more than kMostMessages that nobody has taken end the line. Otherwise reading pauses
  // until they are taken.
  Line(asio::io_context& context, bool is_asked)
      : context_(context), socket_(context), is_asked_(is_asked) {}

  // "": connected. Else why not.
  std::string Connect(std::uint16_t port, milliseconds longest, const std::atomic<bool>& stop) {
    const Clock::time_point until = Clock::now() + longest;
    bool is_done = false;
    ErrorCode error;
    const auto end = [&](ErrorCode code) {
      error = code;
      is_done = true;
    };
    beast::get_lowest_layer(socket_).async_connect(Loopback(port), end);
    if (!Finish(context_, is_done, until, stop)) return Abandon("no answer in time");
    if (error) return error.message();
    beast::get_lowest_layer(socket_).socket().set_option(asio::ip::tcp::no_delay(true), error);
    socket_.read_message_max(InverseLink::kMostBytes);
    is_done = false;
    socket_.async_handshake("127.0.0.1:" + std::to_string(port), "/", end);
    if (!Finish(context_, is_done, until, stop)) return Abandon("no answer in time");
    if (error) return error.message();
    Read();
    return "";
  }

  bool TrySend(std::string_view text) {
    if (is_writing_) return false;
    is_writing_ = true;
    sent_.assign(text);
    socket_.text(true);
    socket_.async_write(asio::buffer(sent_), [this](ErrorCode error, std::size_t) {
      is_writing_ = false;
      if (error && ended_.empty()) ended_ = error.message();
    });
    return true;
  }

  void Close(milliseconds longest) {
    static const std::atomic<bool> kNever{false};
    bool is_done = !ended_.empty();
    if (!is_done)
      socket_.async_close(beast::websocket::close_code::normal, [&](ErrorCode) { is_done = true; });
    if (!Finish(context_, is_done, Clock::now() + longest, kNever)) Abandon("");
  }

  // To poll for more; -1: there is nothing to wait for.
  int handle() {
    return is_paused_ ? -1 : beast::get_lowest_layer(socket_).socket().native_handle();
  }
  std::optional<InverseLink::Message> Take() {
    if (messages_.empty()) return std::nullopt;
    InverseLink::Message message = std::move(messages_.front());
    messages_.pop_front();
    if (ended_.empty() && std::exchange(is_paused_, false)) Read();
    return message;
  }
  // Why there is no more to take; "": there may be.
  std::string ended() const { return messages_.empty() ? ended_ : ""; }

 private:
  // Ends what is under way: its handlers run before this returns.
  std::string Abandon(std::string reason) {
    beast::get_lowest_layer(socket_).close();
    context_.restart();
    context_.poll();
    return reason;
  }

  void Read() {
    socket_.async_read(buffer_, [this](ErrorCode error, std::size_t) {
      if (error) {
        ended_ = error.message();
        return;
      }
      messages_.push_back(
          {.text = socket_.got_text() ? beast::buffers_to_string(buffer_.cdata()) : std::string(),
           .time_ns = MonotonicNowNs()});
      buffer_.consume(buffer_.size());
      if (messages_.size() < InverseLink::kMostMessages) return Read();
      is_paused_ = true;
      if (is_asked_) ended_ = "it sends what nobody asked for";
    });
  }

  asio::io_context& context_;
  WebSocket socket_;
  beast::flat_buffer buffer_;
  std::string sent_;
  const bool is_asked_;
  bool is_paused_ = false;
  bool is_writing_ = false;
  std::deque<InverseLink::Message> messages_;
  std::string ended_;
};

}  // namespace

struct InverseLink::Impl {
  asio::io_context context{1};
  std::optional<Line> line{};
  std::optional<Line> events{};
};

InverseLink::InverseLink(std::uint16_t port, milliseconds longest, const std::atomic<bool>& stop)
    : impl_(std::make_unique<Impl>()) {
  const std::string problem =
      impl_->line.emplace(impl_->context, true).Connect(port, longest, stop);
  if (problem.empty()) return;
  throw BusError(BusFault::kAbsent, "no service at 127.0.0.1:" + std::to_string(port) + " (" +
                                        problem +
                                        "): install Haply's Inverse service and start it "
                                        "(systemctl start haply-inverse-service), or set [device] "
                                        "haply_port");
}

InverseLink::~InverseLink() = default;

bool InverseLink::ListenToEvents(std::uint16_t port, milliseconds longest,
                                 const std::atomic<bool>& stop) {
  if (impl_->events.emplace(impl_->context, false).Connect(port, longest, stop).empty())
    return true;
  impl_->events.reset();
  return false;
}

// The context's own wait has steps of whole ms.
void InverseLink::Wait(microseconds longest) {
  Impl& impl = *impl_;
  int handlers = 0;
  const auto run = [&] {
    while (handlers < kMostHandlers && impl.context.poll_one() > 0) ++handlers;
  };
  impl.context.restart();
  run();
  if (handlers == 0 && longest.count() > 0) {
    std::array<pollfd, 2> sockets{};
    sockets[0] = {.fd = impl.line->handle(), .events = POLLIN, .revents = 0};
    sockets[1] = {.fd = impl.events ? impl.events->handle() : -1, .events = POLLIN, .revents = 0};
    const timespec time{.tv_sec = longest.count() / 1'000'000,
                        .tv_nsec = longest.count() % 1'000'000 * 1000};
    ppoll(sockets.data(), sockets.size(), &time, nullptr);
    run();
  }
  std::string why = impl.line->ended();
  if (handlers == kMostHandlers) why = "it sends without end";
  if (!why.empty()) {
    throw BusError(BusFault::kBroken, "Haply's service ended the connection (" + why + ")");
  }
  why = impl.events ? impl.events->ended() : "";
  if (!why.empty()) {
    throw BusError(BusFault::kBroken, "Haply's service ended its events (" + why + ")");
  }
}

std::optional<InverseLink::Message> InverseLink::TakeMessage() { return impl_->line->Take(); }

std::optional<std::string> InverseLink::TakeEvent() {
  std::optional<Message> event = impl_->events ? impl_->events->Take() : std::nullopt;
  if (!event) return std::nullopt;
  return std::move(event->text);
}

bool InverseLink::TrySend(std::string_view text) { return impl_->line->TrySend(text); }

void InverseLink::Close(milliseconds longest) noexcept {
  try {
    impl_->line->Close(longest);
  } catch (const std::exception&) {
  }
}

InverseAnswer GetFromInverse(std::uint16_t port, const std::string& path, milliseconds longest,
                             const std::atomic<bool>& stop) {
  const Clock::time_point until = Clock::now() + longest;
  asio::io_context context{1};
  beast::tcp_stream stream(context);
  bool is_done = false;
  ErrorCode error;
  const auto end = [&](ErrorCode code, auto&&...) {
    error = code;
    is_done = true;
  };
  const auto goes_well = [&] {
    const bool is_in_time = Finish(context, is_done, until, stop);
    is_done = false;
    return is_in_time && !error;
  };
  stream.async_connect(Loopback(port), end);
  if (!goes_well()) return {};
  http::request<http::empty_body> request{http::verb::get, path, 11};
  request.set(http::field::host, "127.0.0.1:" + std::to_string(port));
  http::async_write(stream, request, end);
  if (!goes_well()) return {};
  beast::flat_buffer buffer(InverseLink::kMostBytes);
  http::response_parser<http::string_body> parser;
  parser.body_limit(InverseLink::kMostBytes);
  http::async_read(stream, buffer, parser, end);
  if (!goes_well()) return {};
  return {.status = static_cast<int>(parser.get().result_int()), .body = parser.get().body()};
}

}  // namespace palpate
