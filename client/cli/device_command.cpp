#include <fmt/core.h>

#include <chrono>
#include <memory>

#include "client/cli/commands.h"
#include "client/cli/description.h"
#include "client/cli/device_test.h"
#include "client/cli/output.h"
#include "common/error/text.h"

namespace palpate::cli {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kLongestTestS = 3600.0;
constexpr double kTestRateHz = 1000.0;
constexpr std::uint32_t kTestBatch = 16;
constexpr std::chrono::milliseconds kPoll(50);

void PrintForces(const client::ForceResult& result, bool json) {
  if (json) {
    Json object = ToJson(result.forces);
    object["applied_tick"] = result.applied_tick;
    WriteOutput(ToText(object));
    return;
  }
  std::string text = Describe(result.forces);
  AppendLine(text, "", fmt::format("since tick {}", result.applied_tick));
  WriteOutput(text);
}

constexpr char kNotKnown[] = "what the forces do is not known: switch the device off";

// For who cannot know whether the stop acted.
std::string ForcesNow(client::Calls& palpated) {
  try {
    return "forces now: " + InWords(palpated.GetDevice().forces);
  } catch (const Error&) {
    return kNotKnown;
  }
}

client::ForceResult StopForces(client::Calls& palpated) {
  const auto began = Clock::now();
  try {
    return palpated.StopForces();
  } catch (const Error& error) {
    const bool is_slow = Clock::now() - began > std::chrono::seconds(1);
    if (error.kind() != ErrorKind::kUnavailable || is_slow) throw;
  }
  palpated.WaitUntilReached(std::chrono::seconds(3));  // it may just be starting
  return palpated.StopForces();
}

void Stop(client::Calls& palpated, bool json) {
  client::ForceResult stopped;
  try {
    stopped = StopForces(palpated);
  } catch (const Error& error) {
    const bool is_away = error.kind() == ErrorKind::kUnavailable;
    throw Error(error.kind(), std::string("the stop is not confirmed: ") + error.what() + "; " +
                                  (is_away ? kNotKnown : ForcesNow(palpated)));
  }
  PrintForces(stopped, json);
  if (!client::AreOff(stopped.forces.state)) {
    throw Error(ErrorKind::kConflict, "somebody has enabled the forces again");
  }
}

void PrintDevices(client::Calls& palpated, bool json) {
  const std::vector<client::ListedDevice> list = palpated.ListDevices();
  if (!json) return WriteOutput(Describe(list));
  WriteOutput(ToText({{"devices", ToJson(list)}}));
}

void PrintDevice(client::Calls& palpated, bool json) {
  const client::DaemonInfo info = palpated.GetDevice();
  WriteOutput(json ? ToText({{"device", ToJson(info.device)},
                             {"health", ToJson(info.health)},
                             {"forces", ForcesJson(info)},
                             {"hand", HandJson(info)}})
                   : Describe(info.device) + Describe(info.health) + DescribeForces(info) +
                         DescribeHand(info));
}

void Calibrate(client::Calls& palpated, const std::string& name, bool json) {
  const client::DeviceHealth health = palpated.CalibrateDevice(name);
  WriteOutput(json ? ToText(ToJson(health)) : Describe(health));
}

void Read(client::Calls& palpated, double seconds, DeviceTest& test) {
  client::PoseReader reader = palpated.ReadPoses(kTestRateHz, kTestBatch);
  const auto end = Clock::now() + std::chrono::duration<double>(seconds);
  while (Clock::now() < end) {
    const std::optional<client::PoseBatch> batch = reader.Next(kPoll);
    if (!batch) continue;
    for (const client::Pose& pose : batch->poses) test.Add(pose);
  }
}

void Test(client::Calls& palpated, double seconds, bool json) {
  DeviceTest test(palpated.GetDevice());
  Read(palpated, seconds, test);
  const client::DaemonInfo after = palpated.GetDevice();
  const DeviceTestFigures figures = test.Figures(after);
  if (json) {
    Json object = {{"device", ToJson(after.device)}};
    object.update(ToJson(figures));
    WriteOutput(ToText(object));
  } else {
    WriteOutput(Describe(after.device) + Describe(figures));
  }
  if (!figures.failures.empty()) {
    throw Error(ErrorKind::kInternal,
                "the device failed its test: " + OneLine(figures.failures.front()));
  }
}

arguments::Command* Add(arguments::Command& device, Invocation& invocation, const std::string& name,
                        const std::string& about, const std::string& footer,
                        const std::function<void(client::Calls&, bool json)>& run) {
  arguments::Command* command = device.add_subcommand(name, about);
  SetFooter(*command, footer);
  AddJson(*command, invocation);
  command->callback([&invocation, run] {
    invocation.command = [&invocation, run](auto& palpated) { run(palpated, invocation.json); };
  });
  return command;
}

void AddInquiries(arguments::Command& device, Invocation& invocation) {
  Add(device, invocation, "list",
      "Lists the devices of the daemon's machine. Says what to do about unusable ones.\n"
      "Opens no device. `[device] kind` in palpated.toml selects the device.",
      "Example: palpate device list --json | jq '.devices[] | select(.usable)'", PrintDevices);
  Add(device, invocation, "info",
      "Shows the daemon's device: what it is, what was seen of it on hardware, how it is\n"
      "now, and what its forces do.",
      "Example: palpate device info --json | jq .health.problem", PrintDevice);
  const auto name = std::make_shared<std::string>();
  Add(device, invocation, "calibrate",
      "Calibrates the device in its place of rest, when the stylus is docked next. Some\n"
      "devices of Force Dimension move their arm by themselves: keep clear of it.",
      "Example: palpate device calibrate",
      [name](client::Calls& palpated, bool json) { Calibrate(palpated, *name, json); })
      ->add_option("name", *name,
                   "The device's kind, as `info` shows it. It must be given where the arm moves.")
      ->option_text("[NAME]");
}

void AddForces(arguments::Command& device, Invocation& invocation) {
  const auto name = std::make_shared<std::string>();
  Add(device, invocation, "enable",
      "Enables forces, with a ramp. Also ends an emergency stop, or a fault that has passed.\n"
      "Hold the stylus. Exit code 10: something keeps the forces off; the error says what.",
      "Example: palpate device enable falcon",
      [name](client::Calls& palpated, bool json) {
        PrintForces(palpated.EnableForces(*name), json);
      })
      ->add_option("name", *name,
                   "The device's kind, as `info` shows it. It must be given where its forces were\n"
                   "never verified on hardware: they may go anywhere.")
      ->option_text("[NAME]");
  Add(device, invocation, "disable",
      "Ramps forces down to zero. They stay off until they are enabled again.",
      "Example: palpate device disable",
      [](client::Calls& palpated, bool json) { PrintForces(palpated.DisableForces(), json); });
  Add(device, invocation, "stop",
      "Emergency stop: zero force within a tick, until forces are enabled again. It always\n"
      "works, whatever else the daemon does.",
      "Example: palpate device stop", Stop)
      ->callback([&invocation] {
        // It has ways of its own to palpated.
        invocation.connects_first = false;
        invocation.command = [&invocation](auto& palpated) { Stop(palpated, invocation.json); };
      });
}

void AddPush(arguments::Command& device, Invocation& invocation) {
  struct Push {
    std::vector<double> force_n{};
    double seconds = 0.5;
  };
  const auto push = std::make_shared<Push>();
  arguments::Command* command =
      Add(device, invocation, "push",
          "Puts a small constant force on the hand for a short time, to try the motors. Nothing\n"
          "else is felt meanwhile. Hold the stylus. Forces must be enabled. Pushes of all clients\n"
          "together take at most 5 s of any 10 s.",
          "Example: palpate device push 0 0.3 0", [push](client::Calls& palpated, bool json) {
            const std::uint64_t tick = palpated.PushHand(
                Vec3(push->force_n[0], push->force_n[1], push->force_n[2]), push->seconds);
            WriteOutput(json ? ToText({{"applied_tick", tick}})
                             : fmt::format("pushes since tick {}\n", tick));
          });
  command
      ->add_option("force", push->force_n,
                   "Force in the device frame, N: to the right, up, towards the user. At most\n"
                   "0.5 N long.")
      ->expected(3)
      ->required()
      ->option_text("X Y Z");
  command->add_option("--seconds", push->seconds, "How long, at most 5 s [default: 0.5]")
      ->check(arguments::Positive(5.0));
}

}  // namespace

void AddDevice(arguments::Command& app, Invocation& invocation) {
  arguments::Command* device =
      app.add_subcommand("device", "The force-feedback device: list, test, enable and stop forces");
  SetFooter(*device,
            "Emergency stop: palpate device stop\n"
            "Example: palpate device info");
  device->require_subcommand(1);
  AddInquiries(*device, invocation);
  AddForces(*device, invocation);
  AddPush(*device, invocation);
  AddProve(*device, invocation);
  const auto seconds = std::make_shared<double>(2.0);
  Add(*device, invocation, "test",
      "Reads the device and judges the readings: rate, losses, noise, buttons.\n"
      "Let the stylus rest, or move it and press its buttons. Forces stay as they are.\n"
      "Exit code 1: the device failed: it is not streaming, has fewer than 900 readings or\n"
      "ticks per second, or more than 1 % of them are lost or corrupt.",
      "Example: palpate device test --seconds 10",
      [seconds](client::Calls& palpated, bool json) { Test(palpated, *seconds, json); })
      ->add_option("--seconds", *seconds, "How long, s [default: 2]")
      ->check(arguments::Positive(kLongestTestS));
}

}  // namespace palpate::cli
