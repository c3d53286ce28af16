#include "client/cli/watch_view.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "client/cli/description.h"
#include "client/sdk/words.h"
#include "common/error/text.h"

namespace palpate::cli {
namespace {

constexpr int kBarWidth = 30;

std::string Aligned(const std::optional<Vec3>& v) {
  return v ? fmt::format("{:>10.3f} {:>10.3f} {:>10.3f} mm", v->x(), v->y(), v->z())
           : fmt::format("{:>10} {:>10} {:>10}", "-", "-", "-");
}

std::string Compact(const std::optional<Vec3>& v) {
  return v ? fmt::format("({:.3f} {:.3f} {:.3f})", v->x(), v->y(), v->z()) : "-";
}

// To a nanometre: volumes of microscopes are as small.
std::string World(const std::optional<Vec3>& v) {
  return v ? fmt::format("({:.6f} {:.6f} {:.6f})", v->x(), v->y(), v->z()) : "-";
}

std::string ForceBar(double force_n, double max_force_n) {
  if (!(max_force_n > 0.0)) {
    return "";
  }
  const double part = std::clamp(force_n / max_force_n, 0.0, 1.0);
  const auto filled = static_cast<std::size_t>(std::lround(part * kBarWidth));
  return fmt::format("[{:<{}}] of {:.3g} N", std::string(filled, '#'), kBarWidth, max_force_n);
}

std::string Isovalue(const WatchStatus& status) {
  return status.normalized_isovalue
             ? fmt::format("{} (normalised {:.4f})", NumberText(status.pose->isovalue),
                           *status.normalized_isovalue)
             : NumberText(status.pose->isovalue);
}

// A daemon of another version may not send the state of the forces.
bool LacksForces(const client::Pose& pose) {
  return pose.forces.state != client::ForceState::kUnknown &&
         pose.forces.state != client::ForceState::kOn;
}

std::string Age(const WatchStatus& status) {
  return fmt::format("{:.1f} ms{}", status.figures.age_ms, status.age_is_exact ? "" : " + network");
}

// Cuts after `columns` characters, not bytes.
std::string Fit(const std::string& line, int columns) {
  int width = 0;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const bool starts_character = (static_cast<unsigned char>(line[i]) & 0xc0) != 0x80;
    if (starts_character && ++width > columns) {
      return line.substr(0, i);
    }
  }
  return line;
}

std::string ProxyInWords(const client::Pose& pose) {
  if (pose.mode == client::ProxyMode::kInside) return "inside the surface: pull out";
  std::string text =
      std::string(NameOf(pose.mode)) + (pose.contact ? ", in contact" : ", no contact");
  if (pose.contact_layer != 0) text += fmt::format(" with layer {}", pose.contact_layer);
  if (pose.layers_passed != 0) text += fmt::format(", layers passed {}", pose.layers_passed);
  return text;
}

// Whether the sample is of now: live, old or of a replay.
std::string WhatIsShown(const WatchStatus& status) {
  if (status.figures.age_ms > status.old_after_ms) {
    return fmt::format("old: nothing came for {:.1f} s", 1e-3 * status.figures.age_ms);
  }
  return status.pose->replayed ? client::InWords(std::nullopt) : "live";
}

std::vector<std::string> LoopLines(const WatchStatus& status) {
  const WatchFigures& f = status.figures;
  return {fmt::format("palpated at {}, {:.1f} s; Ctrl-C ends", status.server, f.seconds),
          fmt::format("stream    {:>7.1f} samples/s   age {}   dropped {}", f.recent_samples_per_s,
                      Age(status), f.dropped_samples),
          fmt::format("loop      {:>7.1f} ticks/s     missed {:.1f}/s, {} in all ({:.3f} %)",
                      f.recent_ticks_per_s, f.recent_missed_per_s, f.total_missed_ticks,
                      f.total_missed_percent),
          fmt::format("update    {:>7.1f} µs mean     p99 {:.1f} µs", f.recent_update.mean_us,
                      f.recent_update.p99_us)};
}

}  // namespace

std::vector<std::string> LiveView(const WatchStatus& status, int columns, int rows) {
  std::vector<std::string> lines = LoopLines(status);
  if (!status.pose) {
    lines.resize(1);
    lines.push_back("no sample yet");
  } else {
    const client::Pose& s = *status.pose;
    const double force_n = s.force_n.norm();
    lines.insert(lines.begin() + 1, "shows     " + WhatIsShown(status));
    lines.push_back("proxy     " + ProxyInWords(s));
    lines.push_back("HIP       " + Aligned(s.hip_mm));
    lines.push_back("SCP_H     " + Aligned(s.scp_h_mm));
    lines.push_back("SCP_V     " + Aligned(s.scp_v_mm));
    lines.push_back("in world  " + World(status.scp_h_world_mm) + " (SCP_H, mm)");
    lines.push_back(
        fmt::format("force     {:>7.3f} N {}", force_n, ForceBar(force_n, status.max_force_n)));
    if (LacksForces(s)) lines.push_back("forces    " + InWords(s.forces));
    lines.push_back(fmt::format("density   {:.6g}   isovalue {}", s.density, Isovalue(status)));
    lines.push_back(
        fmt::format("revision  settings {}   volume {}", s.settings_revision, s.volume_revision));
  }
  lines.resize(std::min(lines.size(), static_cast<std::size_t>(std::max(rows, 0))));
  for (std::string& line : lines) {
    line = Fit(line, columns);
  }
  return lines;
}

std::string LogLine(const WatchStatus& status) {
  const WatchFigures& f = status.figures;
  if (!status.pose) {
    return fmt::format("{:.1f} s: no sample yet", f.seconds);
  }
  const client::Pose& s = *status.pose;
  return fmt::format(
      "{:.1f} s: {}, {:.1f} samples/s, {:.1f} ticks/s, missed {:.1f}/s, {} in all ({:.3f} %), "
      "update mean {:.1f} µs p99 {:.1f} µs, {}, HIP {} SCP_H {} SCP_V {} mm, SCP_H in world {} mm, "
      "force {:.3f} N, {}density {:.6g}, isovalue {}, settings {}, volume {}, age {}, dropped {}",
      f.seconds, WhatIsShown(status), f.recent_samples_per_s, f.recent_ticks_per_s,
      f.recent_missed_per_s, f.total_missed_ticks, f.total_missed_percent, f.recent_update.mean_us,
      f.recent_update.p99_us, ProxyInWords(s), Compact(s.hip_mm), Compact(s.scp_h_mm),
      Compact(s.scp_v_mm), World(status.scp_h_world_mm), s.force_n.norm(),
      LacksForces(s) ? "forces " + NameOf(s.forces) + ", " : "", s.density, Isovalue(status),
      s.settings_revision, s.volume_revision, Age(status), f.dropped_samples);
}

std::string Summary(const WatchFigures& f) {
  const double samples = static_cast<double>(std::max<std::uint64_t>(f.samples, 1));
  return fmt::format(
      "seconds         {:.1f}\n"
      "samples         {}, {} dropped\n"
      "contact         {:.1f} % of samples\n"
      "ticks           {} ({:.1f}/s) + {} missed ({:.1f}/s) = {:.1f}/s\n"
      "missed          {:.3f} %\n"
      "update          mean {:.1f} µs, p99 {:.1f} µs, max {:.1f} µs\n"
      "inside surface  {} samples\n",
      f.seconds, f.samples, f.dropped_samples,
      100.0 * static_cast<double>(f.contact_samples) / samples, f.ticks, f.ticks_per_s,
      f.missed_ticks, f.missed_per_s, f.ticks_per_s + f.missed_per_s, f.missed_percent,
      f.update.mean_us, f.update.p99_us, f.update.max_us, f.inside_samples);
}

}  // namespace palpate::cli
