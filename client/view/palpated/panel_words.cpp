#include "client/view/palpated/panel_words.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdio>
#include <cstdlib>
#include <string_view>

namespace palpate::view {
namespace {

constexpr std::string_view kSuffix = ".mcap";

bool IsTaken(const std::string& name, const client::RecordingList& list) {
  const std::string path = RecordingPath(list.folder, name);
  return std::any_of(list.recordings.begin(), list.recordings.end(),
                     [&](const client::RecordedFile& file) { return file.path == path; });
}

bool IsNumber(std::string_view text) {
  constexpr std::size_t kMostDigits = 6;
  return !text.empty() && text.size() <= kMostDigits &&
         std::all_of(text.begin(), text.end(), [](unsigned char c) { return std::isdigit(c); });
}

}  // namespace

std::string TimeText(std::uint64_t ticks) {
  const std::uint64_t s = ticks / 1000;
  const auto two = [](std::uint64_t value) {
    return (value < 10 ? ":0" : ":") + std::to_string(value);
  };
  if (s < 3600) return std::to_string(s / 60) + two(s % 60);
  return std::to_string(s / 3600) + two(s / 60 % 60) + two(s % 60);
}

std::string SizeText(std::uint64_t bytes) {
  std::array<char, 32> text{};
  const bool is_small = bytes < 1'000'000;
  std::snprintf(text.data(), text.size(), is_small ? "%.0f kB" : "%.1f MB",
                static_cast<double>(bytes) * (is_small ? 1e-3 : 1e-6));
  return text.data();
}

std::string RecordingPath(const std::string& folder, const std::string& name) {
  const std::string file = name.ends_with(kSuffix) ? name : name + std::string(kSuffix);
  return folder.ends_with('/') ? folder + file : folder + '/' + file;
}

std::string RecordingName(const std::string& path) {
  std::string name = path.substr(path.rfind('/') + 1);
  if (name.size() > kSuffix.size() && name.ends_with(kSuffix)) {
    name.resize(name.size() - kSuffix.size());
  }
  return name;
}

std::string NameProblem(const std::string& name, const client::RecordingList& list) {
  if (list.folder.empty()) return "palpated saves nowhere: start it with --save-folder";
  if (name.empty()) return "type a name";
  if (name.find('/') != std::string::npos) return "a name has no /";
  if (IsTaken(name, list)) return "'" + name + "' is taken";
  return {};
}

std::string FreeName(const std::string& name, const client::RecordingList& list) {
  if (!IsTaken(name, list)) return name;
  std::string stem = RecordingName(name);
  unsigned long number = 2;
  const std::size_t dash = stem.rfind('-');
  if (dash != std::string::npos && dash > 0 && IsNumber(std::string_view(stem).substr(dash + 1))) {
    number = std::stoul(stem.substr(dash + 1)) + 1;
    stem.resize(dash);
  }
  // There are at most as many names as recordings.
  for (;; ++number) {
    const std::string next = stem + '-' + std::to_string(number);
    if (!IsTaken(next, list)) return next;
  }
}

namespace {

using client::ConnectionState;
using client::ForceReason;
using client::ForceState;
using client::ProxyMode;

std::string With(const std::string& state, const std::string& why) {
  return why.empty() ? state : state + ": " + why;
}

StateLine OfForces(const client::ForceStatus& forces, const KnownState& known) {
  const std::string why = forces.reason == ForceReason::kDevice && !known.device_problem.empty()
                              ? known.device_problem
                              : std::string(Describe(forces.reason).says);
  const std::string says(Describe(forces.state).says);
  switch (forces.state) {
    case ForceState::kUnknown:
      break;
    case ForceState::kOff:
      return {Tone::kIdle, With(says, why), ForceAction::kEnable};
    case ForceState::kOn:
      if (known.mode == ProxyMode::kSuspended || known.mode == ProxyMode::kInside) {
        const bool is_moved = known.mode == ProxyMode::kSuspended;
        return {is_moved ? Tone::kIdle : Tone::kCaution, std::string(Describe(known.mode).says),
                ForceAction::kDisable};
      }
      return {Tone::kActing, says, ForceAction::kDisable};
    case ForceState::kRampIn:
      return {Tone::kActing, says, ForceAction::kDisable};
    case ForceState::kHeld:
      return {Tone::kCaution, With(says, why), ForceAction::kDisable};
    case ForceState::kFault:
    case ForceState::kStopped:
      return {Tone::kAlarm, With(says, why), ForceAction::kEnable};
  }
  return {Tone::kCaution, says};
}

// What the forces do after the replay.
StateLine OfReplay(const client::ForceStatus& forces, const KnownState& known) {
  StateLine line = OfForces(forces, known);
  line.text = known.replay + (forces.reason == ForceReason::kReplay
                                  ? " " + std::string(Describe(forces.reason).says)
                                  : "; " + line.text);
  if (line.tone != Tone::kAlarm) line.tone = Tone::kCaution;
  return line;
}

}  // namespace

StateLine StateOf(const KnownState& known) {
  if (known.disconnected) return {Tone::kIdle, "not connected"};
  switch (known.connection) {
    case ConnectionState::kConnecting:
      return {Tone::kCaution, "connecting: forces unknown"};
    case ConnectionState::kLost:
      return {Tone::kAlarm, "connection lost: forces unknown"};
    case ConnectionState::kConnected:
      break;
  }
  if (known.silent_s) {
    char seconds[32];
    std::snprintf(seconds, sizeof seconds, "%.1f", *known.silent_s);
    return {Tone::kAlarm,
            std::string("palpated sends nothing for ") + seconds + " s: forces unknown"};
  }
  if (!known.forces) return {Tone::kCaution, "no pose yet: forces unknown"};
  return known.replay.empty() ? OfForces(*known.forces, known) : OfReplay(*known.forces, known);
}

std::optional<double> FractionIn(const std::string& line) {
  const std::size_t comma = line.rfind(", ");
  if (comma == std::string::npos || !line.ends_with(" %")) return std::nullopt;
  char* end = nullptr;
  const char* number = line.c_str() + comma + 2;
  const double percent = std::strtod(number, &end);
  if (end == number || std::string_view(end) != " %" || !(percent >= 0.0 && percent <= 100.0)) {
    return std::nullopt;
  }
  return 0.01 * percent;
}

}  // namespace palpate::view
