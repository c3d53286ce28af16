#include "server/device/forcedimension/forcedimension_bus.h"

#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <utility>

#include "common/error/error.h"
#include "server/device/forcedimension/fd_session.h"
#include "server/realtime/thread_setup.h"

namespace palpate {
namespace {

constexpr const char* kVendor = "1451";

template <class Value>
Value LineOf(const std::filesystem::path& file) {
  Value value{};
  std::ifstream(file) >> value;
  return value;
}

}  // namespace

FdOnUsb FindFdOnUsb(const std::filesystem::path& root) {
  FdOnUsb found;
  std::error_code error;
  for (const auto& entry :
       std::filesystem::directory_iterator(root / "sys/bus/usb/devices", error)) {
    const std::filesystem::path& device = entry.path();
    if (LineOf<std::string>(device / "idVendor") != kVendor) continue;
    ++found.count;
    const std::string node = fmt::format("dev/bus/usb/{:03}/{:03}", LineOf<int>(device / "busnum"),
                                         LineOf<int>(device / "devnum"));
    found.may_open = found.may_open && access((root / node).c_str(), R_OK | W_OK) == 0;
  }
  return found;
}

ForceDimensionBus::ForceDimensionBus(ForceDimensionOptions options)
    : options_(std::move(options)), model_(FdModelOf(options_.model)), spec_(FdSpec(model_)) {
  if (!options_.gripper_button || model_.has_gripper) return;
  throw Error(
      ErrorKind::kInvalidArgument,
      fmt::format("[device] forcedimension_gripper_button: an {} has no gripper", model_.name));
}

std::unique_ptr<StreamSession> ForceDimensionBus::Open(const std::atomic<bool>& /*stop*/) {
  const OrdinaryScheduling ordinary;
  const KeptSignals kept;
  if (!library_) {
    try {
      library_.emplace(options_.library);
    } catch (const Error& error) {
      throw BusError(BusFault::kUnsuitable, error.what());
    }
  }
  exchange_.calibrates = false;
  return std::make_unique<FdSession>(*library_, Choose(), model_, options_, exchange_);
}

char ForceDimensionBus::Choose() const {
  const int count = library_->functions().device_count();
  if (count <= 0) {
    const FdOnUsb found = FindFdOnUsb();
    if (!found.may_open) throw BusError(BusFault::kPermission, std::string(kPermissionHint));
    throw BusError(BusFault::kAbsent,
                   found.count == 0
                       ? "not found: plug it in and switch it on"
                       : "it is on USB, but the library does not find it: end other programs that "
                         "use it, or install a newer SDK");
  }
  std::string others, refused;
  const std::optional<char> chosen = OpenOne(count, others, refused);
  if (chosen) return *chosen;
  if (!others.empty()) {
    // Opened again and again, they would be missing to others: so not often.
    throw BusError(BusFault::kUnsuitable,
                   options_.serial.empty()
                       ? "several are plugged in, with the serial numbers " + others +
                             ": set [device] serial to one of them"
                       : "not found with serial number " + options_.serial + ": plugged in are " +
                             others +
                             (refused.empty() ? "" : ", and one that is refused: " + refused));
  }
  throw BusError(BusFault::kBusy, refused);
}

// Opening is the only way to learn a serial number.
std::optional<char> ForceDimensionBus::OpenOne(int count, std::string& others,
                                               std::string& refused) const {
  const fd::Functions& fd = library_->functions();
  const bool is_any = options_.serial.empty() && count == 1;
  for (int index = 0; index < count; ++index) {
    const int id = fd.open(static_cast<char>(index));
    if (id < 0) {
      refused = fd.last_error() == fd::kErrorInUse
                    ? "another program uses the device: end it (another palpated, the vendor's "
                      "HapticDesk)"
                    : "cannot open the device: " + library_->LastError();
      continue;
    }
    unsigned short serial = 0;  // NOLINT(google-runtime-int): as in C
    fd.serial_number(&serial, static_cast<char>(id));
    const std::string its = std::to_string(serial);
    if (is_any || options_.serial == its) return static_cast<char>(id);
    fd.close(static_cast<char>(id));
    others += (others.empty() ? "" : ", ") + its;
  }
  return std::nullopt;
}

void ForceDimensionBus::RequestCalibration() {
  if (!spec_.calibration_moves_arm) {
    throw Error(ErrorKind::kInvalidArgument,
                fmt::format("an {} is calibrated by hand: put the calibration pole into its pit",
                            model_.name));
  }
  const std::lock_guard lock(requests_);
  // Its stops stay: a second request does not undo them.
  if (exchange_.calibrates) throw Error(ErrorKind::kConflict, "it is being calibrated already");
  exchange_.stops_at_request = exchange_.stops.load();
  exchange_.calibrates = true;
}

}  // namespace palpate
