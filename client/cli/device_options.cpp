#include "client/cli/device_options.h"

#include "client/cli/device_command.h"

namespace palpate::cli {
namespace {

constexpr double kLongestTestS = 3600.0;

arguments::Command* AddCommand(arguments::Command& device, Invocation& invocation,
                               const std::string& name, const std::string& about,
                               const std::string& footer,
                               const std::function<void(const Connection&)>& run) {
  arguments::Command* command = device.add_subcommand(name, about);
  SetFooter(*command, footer);
  command->add_flag("--json", invocation.json, "One JSON object instead of text");
  command->callback([&invocation, run] { invocation.command = run; });
  return command;
}

void AddInquiries(arguments::Command& device, Invocation& invocation) {
  AddCommand(device, invocation, "list",
             "Shows what the daemon's machine has, and what to do about what is not usable.\n"
             "Nothing is opened. Which one is used: `[device] kind` in palpated.toml.",
             "Example: palpate device list --json | jq '.devices[] | select(.usable)'",
             [&invocation](const Connection& c) { PrintDevices(c, invocation.json); });
  AddCommand(device, invocation, "info",
             "Shows the daemon's device: what it is, what was seen of it on hardware, how it is\n"
             "now, and what its forces do.",
             "Example: palpate device info --json | jq .health.problem",
             [&invocation](const Connection& c) { PrintDevice(c, invocation.json); });
  AddCommand(device, invocation, "calibrate",
             "Takes the stylus's place of rest as where it is when it is docked next.",
             "Example: palpate device calibrate",
             [&invocation](const Connection& c) { CalibrateDevice(c, invocation.json); });
}

void AddForces(arguments::Command& device, Invocation& invocation, DeviceValues& values) {
  AddCommand(
      device, invocation, "enable",
      "Lets forces ramp in; also after an emergency stop, and after a fault that has passed.\n"
      "Hold the stylus. Exit code 10: something keeps the forces off, it says what.",
      "Example: palpate device enable falcon",
      [&invocation, &values](const Connection& c) {
        EnableForces(c, values.name, invocation.json);
      })
      ->add_option("name", values.name,
                   "The device's kind, as `info` shows it. It must be given where its forces were\n"
                   "never verified on hardware: they may go anywhere.")
      ->option_text("[NAME]");
  AddCommand(device, invocation, "disable", "Ramps forces out, until they are enabled again.",
             "Example: palpate device disable",
             [&invocation](const Connection& c) { DisableForces(c, invocation.json); });
  AddCommand(device, invocation, "stop",
             "Emergency stop: no force within a tick, until forces are enabled again. It works at\n"
             "any time, whatever else goes on.",
             "Example: palpate device stop",
             [&invocation](const Connection& c) { StopForces(c, invocation.json); });
}

}  // namespace

void AddDevice(arguments::Command& app, Invocation& invocation, DeviceValues& values) {
  arguments::Command* device =
      app.add_subcommand("device", "The force-feedback device: list, test, enable and stop forces");
  SetFooter(*device,
            "Emergency stop: palpate device stop\n"
            "Example: palpate device info");
  device->require_subcommand(1);
  AddInquiries(*device, invocation);
  AddForces(*device, invocation, values);
  AddCommand(
      *device, invocation, "test",
      "Reads the device and judges what comes: readings per second, losses, noise, buttons.\n"
      "Let the stylus rest, or move it and press its buttons. Forces stay as they are.\n"
      "Exit code 1: it failed; not streaming, fewer than 900 readings or ticks per second,\n"
      "more than 1 % lost or corrupt.",
      "Example: palpate device test --seconds 10",
      [&invocation, &values](const Connection& c) {
        TestDevice(c, values.seconds, invocation.json);
      })
      ->add_option("--seconds", values.seconds, "How long, s [default: 2]")
      ->check(arguments::Positive(kLongestTestS));
}

}  // namespace palpate::cli
