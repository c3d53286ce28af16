#include "client/cli/doctor_daemon.h"

#include <fmt/core.h>

#include "client/cli/description.h"
#include "client/cli/output.h"
#include "client/sdk/words.h"
#include "common/error/text.h"

namespace palpate::cli {
namespace {

// The safety stage holds the forces if a larger share of ticks is missed for long.
constexpr double kMostMissed = 0.05;

}  // namespace

Finding JudgeDevice(const client::DaemonInfo& daemon) {
  const client::DeviceHealth& health = daemon.health;
  const std::string name =
      OneLine(daemon.device.kind) + ", " + std::string(NameOf(health.connection));
  const std::string& problem = health.problem;
  const bool streams = health.connection == client::DeviceConnection::kStreaming;
  if (problem.empty() && streams) return {"device", Verdict::kOk, name};
  return {"device", streams ? Verdict::kWarn : Verdict::kFail,
          name + (problem.empty() ? "" : ": " + OneLine(problem)),
          daemon.device.kind == "omni-usb"
              ? doctor::kDrivingKinds
              : "check its cable and power; palpate device info, palpate device list"};
}

void TakeOver(const std::string& kind, Finding& device, std::vector<Finding>& findings) {
  std::string advice;
  std::erase_if(findings, [&](const Finding& finding) {
    if (finding.kind.empty() || finding.kind != kind) return false;
    // The later checks come first: a vendor's library is of use before its device is plugged in.
    advice = finding.advice + (advice.empty() ? "" : "; ") + advice;
    return true;
  });
  if (device.verdict == Verdict::kFail && !advice.empty()) device.advice = advice;
}

Finding JudgeForces(const client::ForceStatus& forces) {
  const client::ForceState state = forces.state;
  if (state == client::ForceState::kOn || state == client::ForceState::kRampIn) {
    return {"forces", Verdict::kOk, NameOf(forces)};
  }
  const std::string advice = InWords(forces.reason);
  return {"forces", state == client::ForceState::kFault ? Verdict::kFail : Verdict::kWarn,
          NameOf(forces), advice.empty() ? "palpate device info" : advice};
}

Finding JudgeTicks(const client::ServoDescription& before, const client::ServoDescription& after) {
  const std::uint64_t ticks = after.ticks - before.ticks;
  const std::uint64_t missed = after.missed_ticks - before.missed_ticks;
  if (ticks == 0) {
    return {"ticks", Verdict::kFail,
            fmt::format("the haptic loop does not tick: it stays at {}", after.ticks),
            "see journalctl -u palpated"};
  }
  const std::string text = fmt::format("{} ticks while it was watched, {} missed", ticks, missed);
  if (static_cast<double>(missed) <= kMostMissed * static_cast<double>(ticks + missed)) {
    return {"ticks", Verdict::kOk, text};
  }
  return {"ticks", Verdict::kWarn, text,
          "see rtprio, kernel and governor above, and end what else keeps this machine busy"};
}

}  // namespace palpate::cli
