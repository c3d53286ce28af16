// The state of the forces as one line for everybody: what is, why, and what the user may do now.
//
// Pure; any thread.
#pragma once

#include <optional>
#include <string>

#include "client/sdk/connection.h"
#include "client/sdk/device.h"
#include "client/sdk/pose.h"

namespace palpate::view {

// kActing: forces act. kIdle: they do not, and all is well. kCaution: they do not, and somebody
// should look, as in a replay. kAlarm: a stop, a fault, a lost device or a lost daemon.
enum class Tone { kActing, kIdle, kCaution, kAlarm };

enum class ForceAction { kNone, kEnable, kDisable };

struct StateLine {
  Tone tone = Tone::kIdle;
  std::string text{};
  ForceAction action = ForceAction::kNone;
};

// What the viewer knows.
struct KnownState {
  bool disconnected = false;  // on request
  client::ConnectionState connection = client::ConnectionState::kConnecting;
  std::optional<double> silent_s{};  // see LiveFeed::silent_s
  std::optional<client::ForceStatus> forces{};
  client::ProxyMode mode = client::ProxyMode::kUnknown;
  std::string device_problem{};  // of DeviceHealth
  std::string replay{};          // the sentence about the replay; empty: the newest pose is live
};

StateLine StateOf(const KnownState& known);

// The fraction, 0 to 1, that a line of palpated such as "loading head.nrrd, 40 %" states; none: it
// states none.
std::optional<double> FractionIn(const std::string& line);

}  // namespace palpate::view
