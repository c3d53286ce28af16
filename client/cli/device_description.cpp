#include "client/cli/device_description.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <vector>

#include "client/cli/output.h"
#include "client/sdk/words.h"
#include "common/error/one_line.h"

namespace palpate::cli {
namespace {

std::string Spaced(std::string_view word) {
  std::string name(word);
  std::replace(name.begin(), name.end(), '-', ' ');
  return name;
}

std::string StateOf(const client::ListedDevice& device) {
  if (device.in_use) return "in use";
  return device.usable ? "usable" : "not usable";
}

using Row = std::array<std::string, 5>;

std::string Line(const Row& row, const std::array<std::size_t, 5>& widths) {
  std::string line;
  for (std::size_t n = 0; n + 1 < row.size(); ++n) {
    line += fmt::format("{:<{}}  ", row[n], widths[n]);
  }
  return line + row.back() + "\n";
}

}  // namespace

Json ForcesJson(const client::DaemonInfo& daemon) {
  Json object = ToJson(daemon.forces);
  object["set_by"] = daemon.forces_set_by;
  return object;
}

Json HandJson(const client::DaemonInfo& daemon) {
  return {{"led_by", daemon.hand_led_by.empty() ? Json() : Json(daemon.hand_led_by)}};
}

std::string NameOf(const client::ForceStatus& forces) {
  const std::string state = Spaced(NameOf(forces.state));
  const bool explained =
      forces.state != client::ForceState::kOn && forces.reason > client::ForceReason::kNone;
  return explained ? state + " (" + Spaced(NameOf(forces.reason)) + ")" : state;
}

std::string InWords(const client::ForceStatus& forces) {
  const std::string state = Spaced(NameOf(forces.state));
  const std::string reason = InWords(forces.reason);
  return reason.empty() ? state : state + ": " + reason;
}

std::string DescribeCaller(const client::DaemonInfo& daemon) {
  std::string text;
  if (daemon.caller.identity.empty()) return text;  // an older daemon does not say
  AppendLine(text, "you are",
             OneLine(daemon.caller.identity) + ", role " + std::string(NameOf(daemon.caller.role)));
  return text;
}

std::string Describe(const client::DeviceDescription& device) {
  const Vec3& low = device.workspace_min_mm;
  const Vec3& high = device.workspace_max_mm;
  const std::string stiffness =
      device.max_stiffness_n_per_mm > 0.0
          ? fmt::format("stiffness up to {:g} N/mm; ", device.max_stiffness_n_per_mm)
          : "";
  std::string text;
  AppendLine(text, "device", device.kind + " (" + device.model + ")");
  AppendLine(text, "",
             "verification level: " + Spaced(NameOf(device.verification_level)) + ": " +
                 InWords(device.verification_level));
  AppendLine(text, "",
             fmt::format("workspace x {:g} to {:g}, y {:g} to {:g}, z {:g} to {:g} mm", low.x(),
                         high.x(), low.y(), high.y(), low.z(), high.z()));
  AppendLine(text, "",
             fmt::format("force at most {:g} N, {:g} N continuously; {}resolution {:g} mm; {} "
                         "button(s)",
                         device.max_force_n, device.continuous_force_n, stiffness,
                         device.position_resolution_mm, device.button_count));
  if (device.max_torque_n_mm > 0.0) {
    const double continuous = device.continuous_torque_n_mm;
    AppendLine(text, "",
               fmt::format("torque at most {:g} N mm", device.max_torque_n_mm) +
                   (continuous > 0.0 ? fmt::format(", {:g} N mm continuously", continuous) : ""));
  }
  return text;
}

std::string Describe(const client::DeviceHealth& health) {
  std::string text;
  AppendLine(text, "health",
             std::string(NameOf(health.connection)) + (health.calibrated ? ", calibrated" : "") +
                 (health.docked ? ", docked" : "") +
                 (health.identity.empty() ? "" : "; " + health.identity));
  const bool has_bus = health.readings + health.transfer_errors + health.connections > 0;
  if (has_bus) {
    AppendLine(text, "",
               fmt::format("{} readings, {} lost, {} frames corrupt, {} transfer errors, {} "
                           "connection(s)",
                           health.readings, health.lost_readings, health.corrupt_frames,
                           health.transfer_errors, health.connections));
    AppendLine(text, "",
               fmt::format("{} forces written, {} times zero by the watchdog",
                           health.forces_written, health.watchdog_zeros));
  }
  if (!health.problem.empty()) AppendLine(text, "", "problem: " + health.problem);
  return text;
}

std::string Describe(const client::ForceStatus& forces) {
  std::string text;
  AppendLine(text, "forces", InWords(forces));
  AppendLine(text, "", fmt::format("at most {:.3g} N now", forces.limit_n));
  return text;
}

std::string DescribeForces(const client::DaemonInfo& daemon) {
  std::string text = Describe(daemon.forces);
  if (!daemon.forces_set_by.empty()) {
    AppendLine(text, "", "set by " + OneLine(daemon.forces_set_by));
  }
  return text;
}

std::string DescribeHand(const client::DaemonInfo& daemon) {
  std::string text;
  if (!daemon.hand_led_by.empty())
    AppendLine(text, "hand", "led by " + OneLine(daemon.hand_led_by));
  return text;
}

std::string Describe(const std::vector<client::ListedDevice>& list) {
  if (list.empty()) return "no devices\n";
  std::vector<Row> rows = {{"device", "port", "verified", "state", "model"}};
  for (const client::ListedDevice& device : list) {
    const std::string serial = device.serial.empty() ? "" : ", serial " + OneLine(device.serial);
    rows.push_back({OneLine(device.kind), device.port.empty() ? "-" : OneLine(device.port) + serial,
                    Spaced(NameOf(device.verification_level)), StateOf(device),
                    OneLine(device.model)});
  }
  std::array<std::size_t, 5> widths{};
  for (const Row& row : rows) {
    for (std::size_t n = 0; n < row.size(); ++n) widths[n] = std::max(widths[n], row[n].size());
  }
  std::string text = Line(rows[0], widths);
  for (std::size_t n = 0; n < list.size(); ++n) {
    text += Line(rows[n + 1], widths);
    const std::string& problem = list[n].problem;
    if (!problem.empty()) text += "  " + OneLine(problem) + "\n";
  }
  return text;
}

}  // namespace palpate::cli
