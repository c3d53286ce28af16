#include "server/app/devices.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <mutex>

#include "common/error/error.h"
#include "server/device/falcon/falcon_protocol.h"
#include "server/device/firewire/fw_node.h"
#include "server/device/omni/omni_firewire.h"
#include "server/device/omni/omni_usb_protocol.h"
#include "server/device/openhaptics/openhaptics_device.h"
#include "server/device/usb/usb_bus.h"
#include "server/recording/recorded_path.h"
#include "server/simulated_hand/explore_script.h"
#include "server/simulated_hand/fixed_scripts.h"
#include "server/simulated_hand/guided_script.h"
#include "server/simulated_hand/led_hand.h"
#include "server/simulated_hand/replay_device.h"
#include "server/simulated_hand/simulated_device.h"

namespace palpate {
namespace {

constexpr std::string_view kKinds =
    "simulated, replay, omni-firewire, falcon, openhaptics, forcedimension, haply, or omni-usb, "
    "which only identifies the device";

constexpr char kNotFound[] = "not found: plug it in and switch it on";

std::unique_ptr<HapticDevice> MakeSimulated(const DeviceConfig& config, HandInboxes& inboxes) {
  constexpr std::uint64_t kSeed = 1;
  const DeviceDescription spec = SimulatedDeviceSpec(config.torque_n_mm);
  std::unique_ptr<StylusScript> hand =
      std::make_unique<ExploreScript>(spec.workspace_min_mm, spec.workspace_max_mm, kSeed);
  hand = std::make_unique<GuidedScript>(std::move(hand), inboxes.plans);
  hand = std::make_unique<PressScript>(std::move(hand),
                                       static_cast<std::uint32_t>(config.pressed_buttons));
  return std::make_unique<SimulatedDevice>(
      std::make_unique<LedScript>(std::move(hand), inboxes.led, spec.workspace_min_mm,
                                  spec.workspace_max_mm),
      spec);
}

std::unique_ptr<HapticDevice> MakeReplay(const DeviceConfig& config) {
  if (config.replay_file.empty()) {
    throw Error(ErrorKind::kInvalidArgument,
                "the device `replay` needs a recording: set [device] replay_file");
  }
  return std::make_unique<ReplayDevice>(ReadStylusPath(config.replay_file));
}

std::unique_ptr<UsbProtocol> MakeOmniUsb(const DeviceConfig& config) {
  return std::make_unique<OmniUsbProtocol>(config.usb_port);
}

std::unique_ptr<UsbProtocol> MakeFalcon(const DeviceConfig& config) {
  return std::make_unique<FalconProtocol>(
      FalconOptions{.port = config.usb_port, .firmware_file = config.falcon_firmware});
}

std::unique_ptr<HapticDevice> OnUsb(std::unique_ptr<UsbProtocol> protocol, int priority) {
  return std::make_unique<StreamedDevice>(std::make_unique<UsbBus>(std::move(protocol)),
                                          "palpate-usb", priority);
}

std::unique_ptr<HapticDevice> MakeOmniFirewire(const DeviceConfig& config, int priority) {
  return std::make_unique<StreamedDevice>(
      std::make_unique<OmniFirewireBus>(OmniFirewireOptions{
          .serial = config.serial, .motor_counts_per_n_mm = config.motor_counts_per_n_mm}),
      "palpate-fw", priority);
}

OpenHapticsOptions OpenHapticsOptionsOf(const DeviceConfig& config) {
  OpenHapticsOptions options;
  if (!config.openhaptics_library.empty()) options.library = config.openhaptics_library;
  options.device_name = config.openhaptics_name;
  return options;
}

std::unique_ptr<HapticDevice> MakeForceDimension(const DeviceConfig& config, int priority) {
  ForceDimensionOptions options = config.forcedimension;
  options.serial = config.serial;
  return std::make_unique<StreamedDevice>(std::make_unique<ForceDimensionBus>(options),
                                          "palpate-fd", priority);
}

std::unique_ptr<HapticDevice> MakeHaply(const DeviceConfig& config, int priority) {
  HaplyOptions options = config.haply;
  options.serial = config.serial;
  return std::make_unique<StreamedDevice>(std::make_unique<HaplyBus>(options), "palpate-haply",
                                          priority);
}

ListedDevice Listed(const DeviceDescription& spec) {
  return {.kind = spec.kind,
          .model = spec.model,
          .usable = true,
          .verification_level = spec.verification_level};
}

ListedDevice ListedReplay(const DeviceConfig& config) {
  ListedDevice listed = Listed(ReplayDeviceSpec());
  if (config.replay_file.empty()) {
    listed.problem = "set [device] replay_file to a recording";
  } else if (!std::filesystem::exists(config.replay_file)) {
    listed.problem = config.replay_file + " is not there";
  }
  listed.usable = listed.problem.empty();
  return listed;
}

ListedDevice ListedOpenHaptics(const DeviceConfig& config) {
  ListedDevice listed = Listed(OpenHapticsDevice(OpenHapticsOptionsOf(config)).spec());
  try {
    const HdLibrary library(OpenHapticsOptionsOf(config).library);
  } catch (const Error& error) {
    listed.problem = error.what();
    listed.usable = false;
  }
  return listed;
}

// Opens none: the library tells serial numbers of opened devices only.
ListedDevice ListedForceDimension(const DeviceConfig& config) {
  ListedDevice listed = Listed(FdSpec(FdModelOf(config.forcedimension.model)));
  const FdOnUsb found = FindFdOnUsb();
  try {
    const FdLibrary library(config.forcedimension.library);
    if (found.count == 0) listed.problem = kNotFound;
    if (!found.may_open) listed.problem = kPermissionHint;
  } catch (const Error& error) {
    listed.problem = error.what();
  }
  listed.usable = listed.problem.empty();
  return listed;
}

void AppendHaply(const DeviceConfig& config, std::vector<ListedDevice>& devices) {
  ListedDevice listed = Listed(HaplySpec(config.haply.model));
  listed.port = "Haply's service";
  // A look is a session of its own: not beside the one that streams.
  if (config.kind == "haply") {
    listed.serial = config.serial;
    devices.push_back(listed);
    return;
  }
  std::vector<InverseArm> found;
  listed.problem = kNotFound;
  try {
    found = FindInverseArms(config.haply.port);
  } catch (const BusError& error) {
    listed.problem = error.what();
  }
  if (found.empty()) {
    listed.usable = false;
    listed.port.clear();
    devices.push_back(listed);
  }
  for (const InverseArm& arm : found) {
    listed.serial = arm.id;
    const std::string type = arm.config ? arm.config->type : "";
    const bool is_other = !type.empty() && type != config.haply.model;
    listed.problem = is_other ? "set [device] haply_model to \"" + type + "\"" : "";
    listed.usable = listed.problem.empty();
    devices.push_back(listed);
  }
}

// Appends one entry for each device that is plugged in, or one entry that says that there is none.
template <class Problem>
void AppendUsb(const DeviceDescription& spec, const std::vector<UsbMatch::Ids>& ids,
               const Problem& problem_of, std::string none, std::vector<ListedDevice>& devices) {
  std::vector<UsbFound> found;
  try {
    found = FindUsbDevices(ids);
  } catch (const BusError& error) {
    none = error.what();
  }
  ListedDevice listed = Listed(spec);
  if (found.empty()) {
    listed.usable = false;
    listed.problem = none;
    devices.push_back(listed);
  }
  for (const UsbFound& device : found) {
    listed.port = device.port;
    listed.problem = problem_of(device.ids);
    if (!device.may_open) listed.problem = kPermissionHint;
    listed.usable = listed.problem.empty();
    devices.push_back(listed);
  }
}

void AppendOmniFirewire(const DeviceConfig& config, std::vector<ListedDevice>& devices) {
  ListedDevice listed = Listed(OmniFirewireSpec(config.motor_counts_per_n_mm.has_value()));
  std::vector<FwFound> found = FindFwNodes(kOmniVendor);
  // The configured one first: of several devices of a kind, the first that works is the daemon's.
  std::stable_partition(found.begin(), found.end(), [&](const FwFound& one) {
    return OmniSerialOf(one.guid) == config.serial;
  });
  for (const FwFound& one : found) {
    listed.port = one.node;
    listed.serial = OmniSerialOf(one.guid);
    listed.problem = one.may_open ? "" : kPermissionHint;
    listed.usable = one.may_open;
    devices.push_back(listed);
  }
  if (!found.empty()) return;
  const std::string problem = OmniFirewireProblem();
  listed.problem = problem.empty() ? kNotFound : "not found: " + problem;
  listed.usable = false;
  devices.push_back(listed);
}

}  // namespace

std::unique_ptr<HapticDevice> MakeDevice(const DeviceConfig& config, int realtime_priority,
                                         HandInboxes& hand) {
  constexpr std::array<std::string_view, 3> kHaveSerials = {"omni-firewire", "forcedimension",
                                                            "haply"};
  if (!config.serial.empty() &&
      std::ranges::find(kHaveSerials, config.kind) == kHaveSerials.end()) {
    throw Error(ErrorKind::kInvalidArgument,
                "[device] serial chooses among devices of kind omni-firewire, forcedimension or "
                "haply only");
  }
  if (config.kind == "omni-firewire") return MakeOmniFirewire(config, realtime_priority);
  if (config.kind == "simulated") return MakeSimulated(config, hand);
  if (config.kind == "replay") return MakeReplay(config);
  if (config.kind == "omni-usb") {
    return OnUsb(MakeOmniUsb(config), realtime_priority);
  }
  if (config.kind == "falcon") {
    return OnUsb(MakeFalcon(config), realtime_priority);
  }
  if (config.kind == "openhaptics") {
    return std::make_unique<OpenHapticsDevice>(OpenHapticsOptionsOf(config));
  }
  if (config.kind == "forcedimension") return MakeForceDimension(config, realtime_priority);
  if (config.kind == "haply") return MakeHaply(config, realtime_priority);
  throw Error(ErrorKind::kInvalidArgument,
              "unknown device " + config.kind + ": give " + std::string(kKinds));
}

std::vector<ListedDevice> ListDevices(const DeviceConfig& config) {
  std::vector<ListedDevice> devices = {Listed(SimulatedDeviceSpec()), ListedReplay(config)};
  AppendOmniFirewire(config, devices);
  AppendUsb(OmniUsbSpec(), OmniUsbIds(), OmniUsbProblem, OmniUsbNotFound(), devices);
  const FalconProtocol falcon(FalconOptions{});
  const auto none = [](const UsbMatch::Ids&) { return std::string(); };
  AppendUsb(falcon.spec(), falcon.match().ids, none, kNotFound, devices);
  devices.push_back(ListedOpenHaptics(config));
  devices.push_back(ListedForceDimension(config));
  AppendHaply(config, devices);
  return devices;
}

std::function<std::vector<ListedDevice>()> DeviceListOf(const DeviceConfig& config) {
  struct Known {
    std::mutex mutex{};
    std::vector<ListedDevice> devices{};
    std::chrono::steady_clock::time_point until{};
  };
  return [&config, known = std::make_shared<Known>()] {
    const std::lock_guard lock(known->mutex);
    if (std::chrono::steady_clock::now() >= known->until) {
      known->devices = ListDevices(config);
      known->until = std::chrono::steady_clock::now() + std::chrono::seconds(1);
    }
    return known->devices;
  };
}

std::uint32_t StopButtons(const DeviceConfig& config, const DeviceDescription& spec) {
  if (config.stop_buttons) {
    if (*config.stop_buttons >> spec.button_count != 0) {
      throw Error(ErrorKind::kInvalidArgument, "[device] stop_buttons names a button that " +
                                                   spec.kind + " does not have: it has " +
                                                   std::to_string(spec.button_count));
    }
    return *config.stop_buttons;
  }
  constexpr std::uint32_t kBoth = 3;
  return IsHardware(spec) && spec.button_count >= 2 ? kBoth : 0;
}

}  // namespace palpate
