// A connection to Haply's service on this machine: its WebSocket, its events, and what it answers
// to HTTP. The only file that includes Boost.Beast is inverse_link.cpp.
//
// The service listens on this machine only, and asks for no password. It is not looked for
// elsewhere.
// Threads: one, such as the I/O thread. Ownership: the destructor closes the connection.
// Errors: BusError.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/geometry/geometry.h"
#include "server/device/stream/bus_error.h"

namespace palpate {

// What is told only in the first reply, and in those that were asked for the full state.
struct InverseConfig {
  std::string type{};          // "inverse3", ...; "": not told
  std::string about{};         // firmware and settings, for people
  bool tells_placing = false;  // basis, mount and filters, as services from 3.5 on do
};

// The messages of Haply's service, which are JSON texts, as values.
//
// Units: m, N. Frame: the service's, right-handed: x right, y away from the user, z up.
// Threads: pure functions. Not real-time: ParseInverse allocates.
// Source: the vendor's documents of service 3.5, and programs that others published for 3.1 to 3.4.
//
// An arm.
struct InverseArm {
  std::string id{};
  Vec3 cursor_m = Vec3::Zero();
  std::optional<Vec3> felt_n{};  // the force that the service says it gives
  std::string mode{};            // "idle", "force", ...; "": not told
  std::string missing{};         // the flag of its status that is not as it must be; "": none
  bool is_in_use = false;
  // Of basis, mount, transform and damping, the one that is not as InverseSetUp sets it; "": none
  // that is told.
  std::string foreign{};
  std::optional<InverseConfig> config{};
};

// A handle.
struct InverseGrip {
  std::string id{};
  std::string family{};  // "wireless_verse_grip", ...
  bool is_awake = true;
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
  std::uint32_t buttons = 0;
};

// Without the devices that are not as documented.
struct InverseReply {
  std::vector<InverseArm> arms{};
  std::vector<InverseGrip> grips{};
  bool has_strange_arm = false;
};

// None: not a reply of the service.
std::optional<InverseReply> ParseInverse(std::string_view text);
// The service's version, from its answer to GET /version: {3, 5}.
std::optional<std::array<int, 2>> ParseInverseVersion(std::string_view text);
// From its answer to GET /settings/devices/force_scale.
std::optional<double> ParseInverseForceScale(std::string_view text);

// An event of the service.
struct InverseEvent {
  std::string arm{};        // its id; "": not told
  std::string text{};       // for people; "": none
  bool ends_force = false;  // its brake or a stalled motor: the device is locked
  bool frees = false;       // its brake let go
};
std::optional<InverseEvent> ParseInverseEvent(std::string_view text);

// Sets the session up. `arm`: its id.
std::string InverseSetUp(std::string_view arm);
// Commands a force, or nothing; asks for one reply.
struct InverseCommand {
  std::optional<Vec3> force_n{};
  bool wants_full_state = false;
  bool is_before_3_5 = false;
};
// The text stays valid until the next call.
class InverseWriter {
 public:
  // grip: "" as its id: there is none.
  InverseWriter(std::string arm, const InverseGrip& grip)
      : arm_(std::move(arm)), grip_(grip.id), grip_family_(grip.family) {}
  std::string_view Write(const InverseCommand& command) noexcept;

 private:
  const std::string arm_, grip_, grip_family_;
  std::array<char, 2048> text_{};  // room for any finite force
};

class InverseLink {
 public:
  static constexpr std::size_t kMostBytes = 64 * 1024;  // of a message
  static constexpr std::size_t kMostMessages = 8;       // that nobody has taken yet

  // Connects; gives up at `longest`, or soon after `stop` becomes true.
  InverseLink(std::uint16_t port, std::chrono::milliseconds longest, const std::atomic<bool>& stop);
  ~InverseLink();
  InverseLink(const InverseLink&) = delete;
  InverseLink& operator=(const InverseLink&) = delete;

  // Also listens to the service's events. Returns false if nobody answers there. If they end later,
  // Wait throws.
  bool ListenToEvents(std::uint16_t port, std::chrono::milliseconds longest,
                      const std::atomic<bool>& stop);

  // Waits until a message, an event or `longest`. Throws what ended the connection.
  void Wait(std::chrono::microseconds longest);
  struct Message {
    std::string text{};
    std::int64_t time_ns = 0;  // when it came, by MonotonicNowNs
  };
  // Of what Wait found, the oldest not taken yet. A message that is no text is an empty one.
  std::optional<Message> TakeMessage();
  std::optional<std::string> TakeEvent();
  // Sends a text. Returns false if the last one is still under way.
  bool TrySend(std::string_view text);
  // Ends the connection in order, within `longest`.
  void Close(std::chrono::milliseconds longest) noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// What the service answers to GET.
struct InverseAnswer {
  int status = 0;  // 200, 404, ...; 0: there was no answer in time
  std::string body{};
};
InverseAnswer GetFromInverse(std::uint16_t port, const std::string& path,
                             std::chrono::milliseconds longest, const std::atomic<bool>& stop);

}  // namespace palpate
