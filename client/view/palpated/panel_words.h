// What panels say of palpated: the session panel, and the line of the state of the forces.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "client/sdk/connection.h"
#include "client/sdk/device.h"
#include "client/sdk/pose.h"
#include "client/sdk/recording.h"

namespace palpate::view {

// "0:12", from an hour on "1:02:03". A tick is a millisecond.
std::string TimeText(std::uint64_t ticks);
// "1.2 MB", "340 kB".
std::string SizeText(std::uint64_t bytes);

// The file of a name in the daemon's folder: with the usual suffix, unless the name has it.
std::string RecordingPath(const std::string& folder, const std::string& name);
// The name that RecordingPath makes this path of, as far as it can be told.
std::string RecordingName(const std::string& path);
// Why a person cannot record to this name; empty: they can.
std::string NameProblem(const std::string& name, const client::RecordingList& list);
// The name itself if it is free, otherwise "name-2" or the first free one after it.
std::string FreeName(const std::string& name, const client::RecordingList& list);

enum class RecordingEvent { kNone, kBegun, kEnded };

// What the session panel says, what it makes of a name that a person types, and how it notices that
// the daemon's recording begins and ends.
//
// Threads: one at a time.
//
// Over one connection.
class RecordingWatch {
 public:
  // Call it once per frame. `running`: whether the daemon records; none: it has not answered.
  RecordingEvent Take(std::optional<bool> running) {
    if (!running || *running == was_running_) return RecordingEvent::kNone;
    was_running_ = *running;
    return was_running_ ? RecordingEvent::kBegun : RecordingEvent::kEnded;
  }

 private:
  bool was_running_ = false;
};

// kActing: forces act. kIdle: they do not, and all is well. kCaution: they do not, and somebody
// should look, as in a replay. kAlarm: a stop, a fault, a lost device or a lost daemon.
enum class Tone { kActing, kIdle, kCaution, kAlarm };

enum class ForceAction { kNone, kEnable, kDisable };

// The state of the forces as one line for everybody: what is, why, and what the user may do now.
//
// Pure; any thread.
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
