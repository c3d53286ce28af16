#include "client/cli/description.h"

#include <fmt/core.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <iterator>
#include <utility>
#include <vector>

#include "client/cli/output.h"
#include "client/cli/setting.h"
#include "client/sdk/words.h"
#include "common/error/error.h"
#include "common/error/text.h"
#include "common/felt_tool/tool_size.h"

namespace palpate::cli {
namespace {

std::string YesOrNo(bool value) { return value ? "yes" : "no"; }

// The box in the world that holds all voxels, by their centres. The world is LPS (towards the
// patient's left, back and head) if the file says so.
std::string WorldBox(const client::VolumeInfo& volume) {
  const Vec3 middle_I = 0.5 * (volume.size - Vec3i::Ones()).cast<double>();
  const Vec3 center = volume.world_from_index.Apply(middle_I);
  const Vec3 half = volume.world_from_index.linear.cwiseAbs() * middle_I;
  const Vec3 low = center - half, high = center + half;
  const bool is_lps = volume.patient_axes == "LPS" && !volume.patient_axes_answered;
  const auto range = [&](int axis) {
    return NumberText(low[axis]) + " to " + NumberText(high[axis]);
  };
  return fmt::format("world{} x {}, y {}, z {} mm, centre {},{},{}", is_lps ? " (LPS)" : "",
                     range(0), range(1), range(2), NumberText(center.x()), NumberText(center.y()),
                     NumberText(center.z()));
}

std::string Orientation(const client::VolumeInfo& volume) {
  if (volume.patient_axes.empty()) {
    return "orientation: unknown; 'palpate place --face=-y --head=+z' says where the patient faces";
  }
  return "orientation: " + volume.patient_axes +
         (volume.patient_axes_answered ? ", as somebody answered" : ", as the file states");
}

}  // namespace

void RequireLive(const client::Settings& settings) {
  if (!settings.replayed) return;
  throw Error(ErrorKind::kConflict,
              "it is set; a recording is replayed, and what is felt is not shown");
}

std::string_view OfReplay(bool replayed) { return replayed ? ", of the replay" : ""; }

void AppendLine(std::string& text, std::string_view subject, std::string_view content) {
  fmt::format_to(std::back_inserter(text), "{:<10}{}\n", subject, OneLine(content));
}

Json ToJson(const client::Settings& settings) {
  Json json = {{"settings_revision", settings.revision}, {"replayed", settings.replayed}};
  for (const Setting& setting : client::kSettings) {
    json[std::string(setting.key)] = SettingJson(setting, settings);
  }
  json["layers"] = ToJson(settings.layers.layer);
  json["tool"] = ToJson(settings.tool);
  json["ball"] = ToJson(settings.ball);
  return json;
}

std::string Describe(const client::ServoDescription& servo) {
  const double due = static_cast<double>(servo.ticks + servo.missed_ticks);
  const double missed = static_cast<double>(servo.missed_ticks);
  std::string text;
  AppendLine(text, "servo",
             fmt::format("{:g} Hz; FIFO scheduling: {}; memory locked: {}", servo.rate_hz,
                         YesOrNo(servo.realtime_scheduling), YesOrNo(servo.memory_locked)));
  AppendLine(text, "",
             fmt::format("{} ticks, {} missed ({:.3f} %), {} scenes applied", servo.ticks,
                         servo.missed_ticks, due > 0.0 ? 100.0 * missed / due : 0.0,
                         servo.scenes_applied));
  for (const std::string& warning : servo.warnings) {
    AppendLine(text, "", "warning: " + warning);
  }
  return text;
}

std::string Describe(const client::VolumeInfo& volume) {
  const Vec3& spacing = volume.spacing_mm;
  const std::string unit = volume.unit.empty() ? "" : " " + volume.unit;
  const std::string type = (volume.original_type.empty() ? "" : ", " + volume.original_type) +
                           (volume.is_level_set ? ", level set" : "");
  std::string text;
  AppendLine(text, "volume",
             fmt::format("{}, revision {}{}", volume.source, volume.volume_revision,
                         OfReplay(volume.replayed)));
  AppendLine(text, "",
             fmt::format("{} x {} x {} voxels of {} x {} x {} mm{}", volume.size.x(),
                         volume.size.y(), volume.size.z(), NumberText(spacing.x()),
                         NumberText(spacing.y()), NumberText(spacing.z()), type));
  AppendLine(text, "",
             fmt::format("values {} to {}{}", NumberText(volume.value_min),
                         NumberText(volume.value_max), unit));
  AppendLine(text, "", WorldBox(volume));
  AppendLine(text, "", Orientation(volume));
  AppendLine(text, "",
             fmt::format("scale {} mm of the device per mm of the volume; {:.1f} MiB",
                         NumberText(volume.device_mm_per_volume_mm),
                         static_cast<double>(volume.memory_bytes) / (1024.0 * 1024.0)));
  if (volume.unsaved_edits > 0) {
    AppendLine(text, "", client::UnsavedInWords(volume.unsaved_edits));
  }
  return text;
}

std::string DescribeWarnings(const client::VolumeInfo& volume) {
  std::string text;
  for (const std::string& warning : volume.warnings) {
    AppendLine(text, "", "warning: " + warning);
  }
  return text;
}

void PrintNotKept(const std::string& why) {
  if (why.empty()) return;
  fmt::print(stderr, "palpate: warning: not kept for palpated's next start: {}\n", OneLine(why));
}

void PrintWarnings(const client::VolumeInfo& volume) {
  for (const std::string& warning : volume.warnings) {
    fmt::print(stderr, "palpate: warning: {}\n", OneLine(warning));
  }
}

std::string Describe(const client::Settings& settings) {
  std::string text;
  AppendLine(text, "settings",
             fmt::format("revision {}{}", settings.revision, OfReplay(settings.replayed)));
  const std::string normalized =
      client::IsKnown(settings, client::kNormalizedIsovalue)
          ? " (normalised " + NumberText(settings.normalized_isovalue) + ")"
          : "";
  AppendLine(text, "", "isovalue " + NumberText(settings.isovalue) + normalized);
  if (!settings.layers.layer.empty()) {
    AppendLine(text, "", "felt in place of isovalue, stiffness, damping, friction and pop_force:");
  }
  for (const SurfaceLayer& layer : settings.layers.layer) {
    AppendLine(text, "", "layer " + Describe(layer));
  }
  if (!settings.tool.ball.empty()) AppendLine(text, "", "tool " + InWords(settings.tool));
  std::string off;
  for (const Setting& setting : client::kHapticSettings) {
    if (SettingJson(setting, settings).is_null()) continue;  // an older daemon does not have it
    if (IsOff(setting, settings)) {
      off += (off.empty() ? "off: " : ", ") + std::string(setting.name);
    } else {
      AppendLine(text, "", DescribeSetting(setting, settings));
    }
  }
  if (!off.empty()) AppendLine(text, "", off);
  const std::string ball = client::BallInWords(settings);
  if (!ball.empty()) AppendLine(text, "", OneLine(ball));
  return text;
}

std::string ToText(const Json& json, int indent) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace) + "\n";
}

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
