#include "client/cli/description.h"

#include <fmt/format.h>

#include <iterator>
#include <utility>

#include "client/cli/layers.h"
#include "client/cli/output.h"
#include "client/cli/setting.h"
#include "client/sdk/words.h"
#include "common/error/error.h"
#include "common/error/number_text.h"
#include "common/error/one_line.h"

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
  if (!settings.tool.ball.empty()) AppendLine(text, "", Describe(settings.tool));
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

}  // namespace palpate::cli
