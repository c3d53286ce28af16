#include "client/cli/device_description.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <vector>

#include "client/cli/output.h"
#include "common/error/one_line.h"
#include "common/wire/force_words.h"

namespace palpate::cli {
namespace {

std::string Spaced(std::string name) {
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

std::string StateOf(const v1::ListedDevice& device) {
  if (device.in_use()) return "in use";
  return device.usable() ? "usable" : "not usable";
}

using Row = std::array<std::string, 5>;

std::string Line(const Row& row, const std::array<std::size_t, 5>& widths) {
  std::string line;
  for (std::size_t n = 0; n + 1 < row.size(); ++n) {
    line += fmt::format("{:<{}}  ", row[n], widths[n]);
  }
  return line + row.back() + "\n";
}

const char* RoleName(const v1::CallerDescription& caller) {
  switch (caller.role()) {
    case v1::ROLE_VIEWER:
      return "viewer";
    case v1::ROLE_EDITOR:
      return "editor";
    case v1::ROLE_OPERATOR:
      return "operator";
    case v1::ROLE_ADMIN:
      return "admin";
    default:
      return "unspecified";
  }
}

}  // namespace

Json ToJson(const v1::CallerDescription& caller) {
  return {{"identity", caller.identity()}, {"role", RoleName(caller)}};
}

Json ToJson(const v1::DeviceDescription& device) {
  return {{"kind", device.kind()},
          {"model", device.model()},
          {"workspace_min_mm", ToJson(device.workspace_min_mm())},
          {"workspace_max_mm", ToJson(device.workspace_max_mm())},
          {"max_force_n", device.max_force_n()},
          {"continuous_force_n", device.continuous_force_n()},
          {"max_stiffness_n_per_mm", device.max_stiffness_n_per_mm()},
          {"position_resolution_mm", device.position_resolution_mm()},
          {"button_count", device.button_count()},
          {"verification_level", NameOf(device.verification_level())}};
}

Json ToJson(const v1::DeviceHealth& health) {
  return {{"connection", NameOf(health.connection())},
          {"docked", health.docked()},
          {"calibrated", health.calibrated()},
          {"identity", health.identity()},
          {"problem", health.problem()},
          {"readings", health.readings()},
          {"forces_written", health.forces_written()},
          {"lost_readings", health.lost_readings()},
          {"corrupt_frames", health.corrupt_frames()},
          {"transfer_errors", health.transfer_errors()},
          {"connections", health.connections()},
          {"watchdog_zeros", health.watchdog_zeros()}};
}

Json ToJson(const v1::ForceStatus& forces) {
  return {{"state", palpate::NameOf(forces.state())},
          {"reason", palpate::NameOf(forces.reason())},
          {"limit_n", forces.limit_n()}};
}

Json ToJson(const v1::ListedDevice& device) {
  return {
      {"kind", device.kind()},       {"model", device.model()},
      {"port", device.port()},       {"usable", device.usable()},
      {"problem", device.problem()}, {"verification_level", NameOf(device.verification_level())},
      {"in_use", device.in_use()}};
}

std::string NameOf(v1::VerificationLevel level) {
  switch (level) {
    case v1::VERIFICATION_LEVEL_NONE:
      return "none";
    case v1::VERIFICATION_LEVEL_ENUMERATED:
      return "enumerated";
    case v1::VERIFICATION_LEVEL_IDENTIFIED:
      return "identified";
    case v1::VERIFICATION_LEVEL_STATE_READ:
      return "state_read";
    case v1::VERIFICATION_LEVEL_FORCE_VERIFIED:
      return "force_verified";
    case v1::VERIFICATION_LEVEL_SIMULATED:
      return "simulated";
    default:
      return "unspecified";
  }
}

std::string InWords(v1::VerificationLevel level) {
  const std::string name = Spaced(NameOf(level));
  switch (level) {
    case v1::VERIFICATION_LEVEL_NONE:
      return name + ": nothing of it was seen on hardware";
    case v1::VERIFICATION_LEVEL_ENUMERATED:
      return name + ": it was found and opened on hardware, no more";
    case v1::VERIFICATION_LEVEL_IDENTIFIED:
      return name + ": it told who it is on hardware, no more";
    case v1::VERIFICATION_LEVEL_STATE_READ:
      return name + ": positions and buttons were right on hardware, forces not tried";
    case v1::VERIFICATION_LEVEL_FORCE_VERIFIED:
      return name + ": forces had the right direction and size on hardware";
    case v1::VERIFICATION_LEVEL_SIMULATED:
      return name + ": there is no hardware to verify";
    default:
      return name;
  }
}

std::string NameOf(v1::DeviceConnection connection) {
  switch (connection) {
    case v1::DEVICE_CONNECTION_ABSENT:
      return "absent";
    case v1::DEVICE_CONNECTION_CONNECTING:
      return "connecting";
    case v1::DEVICE_CONNECTION_STREAMING:
      return "streaming";
    default:
      return "unspecified";
  }
}

std::string NameOf(const v1::ForceStatus& forces) {
  const std::string state = Spaced(palpate::NameOf(forces.state()));
  const bool explained =
      forces.state() != v1::FORCE_STATE_ON && forces.reason() > v1::FORCE_REASON_NONE;
  return explained ? state + " (" + Spaced(palpate::NameOf(forces.reason())) + ")" : state;
}

std::string InWords(const v1::ForceStatus& forces) {
  const std::string state = Spaced(palpate::NameOf(forces.state()));
  const std::string reason = palpate::InWords(forces.reason());
  return reason.empty() ? state : state + ": " + reason;
}

std::string Describe(const v1::CallerDescription& caller) {
  std::string text;
  if (caller.identity().empty()) return text;  // of an older daemon
  AppendLine(text, "you are", OneLine(caller.identity()) + ", role " + RoleName(caller));
  return text;
}

std::string Describe(const v1::DeviceDescription& device) {
  const v1::Vector3& low = device.workspace_min_mm();
  const v1::Vector3& high = device.workspace_max_mm();
  const std::string stiffness =
      device.max_stiffness_n_per_mm() > 0.0
          ? fmt::format("stiffness up to {:g} N/mm; ", device.max_stiffness_n_per_mm())
          : "";
  std::string text;
  AppendLine(text, "device", device.kind() + " (" + device.model() + ")");
  AppendLine(text, "", "verification level: " + InWords(device.verification_level()));
  AppendLine(text, "",
             fmt::format("workspace x {:g} to {:g}, y {:g} to {:g}, z {:g} to {:g} mm", low.x(),
                         high.x(), low.y(), high.y(), low.z(), high.z()));
  AppendLine(text, "",
             fmt::format("force at most {:g} N, {:g} N continuously; {}resolution {:g} mm; {} "
                         "button(s)",
                         device.max_force_n(), device.continuous_force_n(), stiffness,
                         device.position_resolution_mm(), device.button_count()));
  return text;
}

std::string Describe(const v1::DeviceHealth& health) {
  std::string text;
  AppendLine(text, "health",
             NameOf(health.connection()) + (health.calibrated() ? ", calibrated" : "") +
                 (health.docked() ? ", docked" : "") +
                 (health.identity().empty() ? "" : "; " + health.identity()));
  const bool has_bus = health.readings() + health.transfer_errors() + health.connections() > 0;
  if (has_bus) {
    AppendLine(text, "",
               fmt::format("{} readings, {} lost, {} frames corrupt, {} transfer errors, {} "
                           "connection(s)",
                           health.readings(), health.lost_readings(), health.corrupt_frames(),
                           health.transfer_errors(), health.connections()));
    AppendLine(text, "",
               fmt::format("{} forces written, {} times zero by the watchdog",
                           health.forces_written(), health.watchdog_zeros()));
  }
  if (!health.problem().empty()) AppendLine(text, "", "problem: " + health.problem());
  return text;
}

std::string Describe(const v1::ForceStatus& forces) {
  std::string text;
  AppendLine(text, "forces", InWords(forces));
  AppendLine(text, "", fmt::format("at most {:.3g} N now", forces.limit_n()));
  return text;
}

std::string Describe(const v1::ListDevicesResponse& list) {
  if (list.devices().empty()) return "no devices\n";
  std::vector<Row> rows = {{"device", "port", "verified", "state", "model"}};
  for (const v1::ListedDevice& device : list.devices()) {
    rows.push_back({OneLine(device.kind()), device.port().empty() ? "-" : OneLine(device.port()),
                    Spaced(NameOf(device.verification_level())), StateOf(device),
                    OneLine(device.model())});
  }
  std::array<std::size_t, 5> widths{};
  for (const Row& row : rows) {
    for (std::size_t n = 0; n < row.size(); ++n) widths[n] = std::max(widths[n], row[n].size());
  }
  std::string text = Line(rows[0], widths);
  for (int n = 0; n < list.devices_size(); ++n) {
    text += Line(rows[static_cast<std::size_t>(n) + 1], widths);
    const std::string& problem = list.devices(n).problem();
    if (!problem.empty()) text += "  " + OneLine(problem) + "\n";
  }
  return text;
}

}  // namespace palpate::cli
