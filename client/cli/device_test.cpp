#include "client/cli/device_test.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "client/cli/description.h"
#include "client/cli/watch_statistics.h"

namespace palpate::cli {
namespace {

constexpr double kLeastPerS = 900.0;
constexpr double kMostPercent = 1.0;
// If a hand holds the stylus, the stylus moves farther.
constexpr double kRestRangeMm = 1.0;
constexpr int kButtons = 32;

// The rise of a count. If the daemon was restarted in between, the count begins again at 0.
std::uint64_t Rise(std::uint64_t before, std::uint64_t after) {
  return after > before ? after - before : 0;
}

std::vector<int> Buttons(std::uint32_t bits) {
  std::vector<int> buttons;
  for (int n = 0; n < kButtons; ++n) {
    if ((bits >> n & 1u) != 0) buttons.push_back(n);
  }
  return buttons;
}

void AddCountFailures(DeviceTestFigures& f) {
  if (f.is_simulated) return;
  if (f.readings_per_s < kLeastPerS) {
    f.failures.push_back(
        fmt::format("{:.0f} readings per s, not {:g}: check its cable, use another port, no hub",
                    f.readings_per_s, kLeastPerS));
  }
  if (f.ticks_per_s < kLeastPerS) {
    f.failures.push_back(
        fmt::format("the haptic loop has {:.0f} ticks per s, not {:g}: see the warnings of "
                    "'palpate info'",
                    f.ticks_per_s, kLeastPerS));
  }
  if (f.lost_percent > kMostPercent) {
    f.failures.push_back(
        fmt::format("{:.1f} % of the readings are lost: use another port, no hub", f.lost_percent));
  }
  if (f.corrupt_percent > kMostPercent) {
    f.failures.push_back(fmt::format(
        "{:.1f} % of the frames are corrupt: check its cable, and that it is a `[device] kind` of "
        "its own",
        f.corrupt_percent));
  }
}

void AddFailures(const client::DeviceHealth& before, const client::DeviceHealth& after,
                 DeviceTestFigures& f) {
  const bool streams = before.connection == client::DeviceConnection::kStreaming &&
                       after.connection == client::DeviceConnection::kStreaming;
  if (!streams) {
    const std::string& problem = after.problem.empty() ? before.problem : after.problem;
    f.failures.push_back(
        "the device is not streaming: " +
        (problem.empty() ? "see 'palpate device list', and palpated's log" : problem));
  }
  if (f.samples == 0) {
    f.failures.emplace_back("no ticks came: see 'palpate info', and palpated's log");
  }
  if (f.replayed) {
    f.failures.emplace_back("a recording was replayed: test the device when the replay has ended");
  }
  if (streams) AddCountFailures(f);
}

std::string PositionLine(const DeviceTestFigures& f) {
  const std::string range = fmt::format("moved within {:.3f} x {:.3f} x {:.3f} mm", f.range_mm[0],
                                        f.range_mm[1], f.range_mm[2]);
  return f.rested ? range + fmt::format("; noise at rest {:.4f}, {:.4f}, {:.4f} mm", f.noise_mm[0],
                                        f.noise_mm[1], f.noise_mm[2])
                  : range + "; it was not at rest, so its noise is not known";
}

std::string ReadingsLine(const DeviceTestFigures& f) {
  return f.is_simulated
             ? "simulated: one per tick"
             : fmt::format(
                   "{:.1f} per s; {} lost ({:.2f} %), {} corrupt ({:.2f} %), {} transfer "
                   "errors",
                   f.readings_per_s, f.lost_readings, f.lost_percent, f.corrupt_frames,
                   f.corrupt_percent, f.transfer_errors);
}

}  // namespace

void DeviceTest::Add(const client::Pose& pose) {
  for (int n = 0; n < 3; ++n) {
    Axis& axis = axes_[static_cast<std::size_t>(n)];
    if (counts_.samples == 0) axis.first_mm = pose.hip_mm[n];
    const double moved_mm = pose.hip_mm[n] - axis.first_mm;
    axis.low_mm = std::min(axis.low_mm, moved_mm);
    axis.high_mm = std::max(axis.high_mm, moved_mm);
    axis.sum_mm += moved_mm;
    axis.sum_mm2 += moved_mm * moved_mm;
  }
  ++counts_.samples;
  counts_.stale_ticks += pose.forces.reason == client::ForceReason::kStale ? 1 : 0;
  counts_.fault_ticks += pose.mode == client::ProxyMode::kFault ? 1 : 0;
  counts_.replayed = counts_.replayed || pose.replayed;
  counts_.buttons |= pose.buttons;
}

DeviceTestFigures DeviceTest::Figures(const client::DaemonInfo& after) const {
  DeviceTestFigures f = counts_;
  const client::DeviceHealth& first = before_.health;
  const client::DeviceHealth& last = after.health;
  f.is_simulated = after.device.verification_level == client::VerificationLevel::kSimulated;
  f.forces = after.forces;
  f.ticks = Rise(before_.servo.ticks, after.servo.ticks);
  f.missed_ticks = Rise(before_.servo.missed_ticks, after.servo.missed_ticks);
  f.readings = Rise(first.readings, last.readings);
  f.lost_readings = Rise(first.lost_readings, last.lost_readings);
  f.corrupt_frames = Rise(first.corrupt_frames, last.corrupt_frames);
  f.transfer_errors = Rise(first.transfer_errors, last.transfer_errors);
  f.lost_percent = Percent(f.lost_readings, f.readings);
  f.corrupt_percent = Percent(f.corrupt_frames, f.readings);
  // The loop's clock: executed and missed ticks.
  if (after.servo.rate_hz > 0.0) {
    f.seconds = static_cast<double>(f.ticks + f.missed_ticks) / after.servo.rate_hz;
  }
  if (f.seconds > 0.0) {
    f.ticks_per_s = static_cast<double>(f.ticks) / f.seconds;
    f.readings_per_s = static_cast<double>(f.readings) / f.seconds;
  }
  f.rested = f.samples > 0;
  const double count = static_cast<double>(std::max<std::uint64_t>(f.samples, 1));
  for (std::size_t n = 0; n < axes_.size(); ++n) {
    const Axis& axis = axes_[n];
    const double mean_mm = axis.sum_mm / count;
    f.range_mm[n] = axis.high_mm - axis.low_mm;
    f.noise_mm[n] = std::sqrt(std::max(axis.sum_mm2 / count - mean_mm * mean_mm, 0.0));
    // Written so that NaN counts as motion.
    f.rested = f.rested && f.range_mm[n] <= kRestRangeMm;
  }
  AddFailures(first, last, f);
  return f;
}

std::string Describe(const DeviceTestFigures& f) {
  const std::vector<int> buttons = Buttons(f.buttons);
  std::string text;
  AppendLine(text, "readings", ReadingsLine(f));
  AppendLine(text, "ticks",
             fmt::format("{:.1f} per s in {:.1f} s, {} missed; of {} seen {} stale, {} with a "
                         "fault",
                         f.ticks_per_s, f.seconds, f.missed_ticks, f.samples, f.stale_ticks,
                         f.fault_ticks));
  AppendLine(text, "position", PositionLine(f));
  AppendLine(text, "buttons",
             buttons.empty() ? "none was pressed" : fmt::format("{}", fmt::join(buttons, ", ")));
  AppendLine(text, "forces", InWords(f.forces));
  AppendLine(text, "verdict", f.failures.empty() ? "passed" : "failed");
  for (const std::string& failure : f.failures) AppendLine(text, "", failure);
  return text;
}

Json ToJson(const DeviceTestFigures& f) {
  return {{"passed", f.failures.empty()},
          {"failures", f.failures},
          {"seconds", f.seconds},
          {"ticks", f.ticks},
          {"ticks_per_s", f.ticks_per_s},
          {"missed_ticks", f.missed_ticks},
          {"readings", f.readings},
          {"readings_per_s", f.readings_per_s},
          {"lost_readings", f.lost_readings},
          {"lost_percent", f.lost_percent},
          {"corrupt_frames", f.corrupt_frames},
          {"corrupt_percent", f.corrupt_percent},
          {"transfer_errors", f.transfer_errors},
          {"samples", f.samples},
          {"stale_ticks", f.stale_ticks},
          {"fault_ticks", f.fault_ticks},
          {"range_mm", f.range_mm},
          {"noise_at_rest_mm", f.rested ? Json(f.noise_mm) : Json()},
          {"buttons", Buttons(f.buttons)},
          {"forces", ToJson(f.forces)}};
}

}  // namespace palpate::cli
