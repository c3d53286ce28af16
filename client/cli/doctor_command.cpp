#include "client/cli/commands.h"

#include <fmt/core.h>

#include <algorithm>
#include <chrono>
#include <optional>
#include <thread>

#include "client/cli/description.h"
#include "client/cli/doctor/checks.h"
#include "client/cli/doctor/ports.h"
#include "client/cli/doctor_daemon.h"
#include "client/cli/output.h"
#include "client/cli/reach.h"
#include "client/sdk/calls.h"
#include "common/error/text.h"
#include "common/wire/address.h"

namespace palpate::cli {
namespace {

// The time between two looks at the daemon: some hundreds of ticks.
constexpr std::chrono::milliseconds kWatched{300};

constexpr const char* NameOf(Verdict verdict) {
  switch (verdict) {
    case Verdict::kOk:
      return "ok";
    case Verdict::kWarn:
      return "warn";
    case Verdict::kFail:
      return "fail";
  }
  return "";
}

Finding VersionFinding(const std::string& version) {
  if (version == PALPATE_VERSION) return {"version", Verdict::kOk, version + ", as the daemon's"};
  return {"version", Verdict::kWarn,
          "the daemon is " + OneLine(version) + ", this client " PALPATE_VERSION,
          "install the same version of palpate-daemon and palpate-client"};
}

Finding ServoFinding(const client::ServoDescription& servo) {
  if (servo.realtime_scheduling && servo.memory_locked) {
    return {"servo", Verdict::kOk, "real-time scheduling, memory locked"};
  }
  const std::string advice =
      servo.warnings.empty() ? "see the log of palpated" : OneLine(servo.warnings.front());
  return {
      "servo", Verdict::kWarn,
      fmt::format("{} scheduling, memory {}", servo.realtime_scheduling ? "real-time" : "ordinary",
                  servo.memory_locked ? "locked" : "not locked"),
      advice};
}

// What a daemon answers, if there is one.
struct Asked {
  std::vector<Finding> findings{};
  std::string device_kind{};  // empty: it did not say
  Finding device{};
  std::optional<Finding> forces{};  // a device that gets no force has none
};

Asked AskDaemon(const client::Server& server) {
  Asked asked;
  std::vector<Finding>& findings = asked.findings;
  try {
    const std::unique_ptr<client::Calls> palpated = Reach(server);
    const client::DaemonInfo first = palpated->GetDevice();
    findings.push_back({"daemon", Verdict::kOk, "answers at " + palpated->name()});
    findings.push_back(VersionFinding(first.servo.version));
    findings.push_back(ServoFinding(first.servo));
    std::this_thread::sleep_for(kWatched);
    const client::DaemonInfo last = palpated->GetDevice();
    findings.push_back(JudgeTicks(first.servo, last.servo));
    asked.device = JudgeDevice(last);
    asked.device_kind = last.device.kind;
    if (last.device.max_force_n > 0.0) asked.forces = JudgeForces(last.forces);
  } catch (const Error& error) {
    findings.push_back({"daemon", Verdict::kWarn, OneLine(error.what()),
                        "systemctl status palpated; journalctl -u palpated"});
  }
  return asked;
}

bool IsThisMachine(const client::Address& address) {
  return address.host_port.empty() || IsLoopback(ParseHostPort(address.host_port));
}

std::vector<Finding> CheckMachine(const doctor::Workstation& machine,
                                  const client::Address& address) {
  std::vector<Finding> findings = doctor::CheckWorkstation(machine);
  findings.push_back(doctor::CheckPort(machine));
  findings.push_back(doctor::CheckMetricsPort(machine));
  for (const Finding& finding : doctor::CheckDaemonPorts(machine)) findings.push_back(finding);
  if (address.host_port.empty()) {
    findings.push_back(doctor::CheckSocket(machine, client::SocketPathOf(address)));
  }
  return findings;
}

// All findings: first about the machine, then about the daemon.
std::vector<Finding> Examine(const client::Server& server) {
  Asked asked = AskDaemon(server);
  doctor::Workstation machine = doctor::ThisMachine();
  const bool has_device = !asked.device_kind.empty();
  if (!has_device) {
    machine.device_kind = doctor::Configured(machine, "device", "kind").value_or("");
  } else if (IsThisMachine(server.address)) {
    machine.device_kind = asked.device_kind;
  }
  std::vector<Finding> findings = CheckMachine(machine, server.address);
  if (has_device) TakeOver(machine.device_kind, asked.device, findings);
  findings.insert(findings.end(), asked.findings.begin(), asked.findings.end());
  if (has_device) findings.push_back(asked.device);
  if (asked.forces) findings.push_back(*asked.forces);
  return findings;
}

std::string ToLine(const Finding& finding) {
  std::string line =
      fmt::format("{:<5}{:<10}{}\n", NameOf(finding.verdict), finding.name, finding.text);
  if (!finding.advice.empty()) line += fmt::format("{:<15}-> {}\n", "", finding.advice);
  return line;
}

}  // namespace

void AddDoctor(arguments::Command& app, DoctorValues& values) {
  arguments::Command* command = app.add_subcommand(
      "doctor",
      "Checks this machine: kernel, rights, clock, quota, devices, folders, ports; and of the\n"
      "daemon, if there is one, its device, forces and ticks. Says for each whether it is ok,\n"
      "and what to do where it is not.");
  command->footer(
      "Exit code 10 where something cannot work as it is.\n"
      "Example: palpate doctor --json | jq '.checks[] | select(.verdict != \"ok\")'");
  command->add_flag("--json", values.json, "One JSON object instead of text");
  command->callback([&values] { values.requested = true; });
}

int RunDoctor(const client::Server& server, bool json) {
  const std::vector<Finding> findings = Examine(server);
  const bool fails = std::any_of(findings.begin(), findings.end(), [](const Finding& finding) {
    return finding.verdict == Verdict::kFail;
  });
  if (json) {
    Json checks = Json::array();
    for (const Finding& finding : findings) {
      checks.push_back({{"name", finding.name},
                        {"verdict", NameOf(finding.verdict)},
                        {"text", finding.text},
                        {"advice", finding.advice}});
    }
    WriteOutput(ToText(Json{{"fit", !fails}, {"checks", checks}}, 2));
  } else {
    std::string text;
    for (const Finding& finding : findings) text += ToLine(finding);
    WriteOutput(text);
  }
  return fails ? ExitCode(ErrorKind::kFailedPrecondition) : 0;
}

}  // namespace palpate::cli
