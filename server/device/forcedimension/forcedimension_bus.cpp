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

FdPlugged FindPluggedFd() {
  FdPlugged plugged;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator("/sys/bus/usb/devices", error)) {
    const std::filesystem::path& device = entry.path();
    if (LineOf<std::string>(device / "idVendor") != kVendor) continue;
    ++plugged.count;
    const std::string node = fmt::format("/dev/bus/usb/{:03}/{:03}", LineOf<int>(device / "busnum"),
                                         LineOf<int>(device / "devnum"));
    plugged.may_open &= access(node.c_str(), R_OK | W_OK) == 0;
  }
  return plugged;
}

ForceDimensionBus::ForceDimensionBus(ForceDimensionOptions options)
    : options_(std::move(options)), model_(FdModelOf(options_.model)), spec_(FdSpec(model_)) {}

std::unique_ptr<StreamSession> ForceDimensionBus::Open() {
  const OrdinaryScheduling ordinary;
  if (!library_) {
    try {
      library_.emplace(options_.library);
    } catch (const Error& error) {
      throw BusError(BusFault::kUnsuitable, error.what());
    }
  }
  exchange_.calibration_wanted = false;
  return std::make_unique<FdSession>(*library_, Choose(), model_, options_, exchange_);
}

// Opening is the only way to learn a serial number. It moves nothing.
char ForceDimensionBus::Choose() const {
  const fd::Functions& fd = library_->functions();
  const int count = fd.device_count();
  if (count <= 0) {
    if (!FindPluggedFd().may_open) {
      throw BusError(BusFault::kPermission,
                     "this user may not open the device: install deploy/udev/70-palpate.rules, "
                     "then unplug it and plug it in again");
    }
    throw BusError(BusFault::kAbsent, "not found: plug it in and switch it on");
  }
  std::string others, refused;
  std::optional<char> chosen;
  bool is_in_use = false;
  for (int index = 0; index < count; ++index) {
    const int id = fd.open(static_cast<char>(index));
    if (id < 0) {
      is_in_use |= fd.last_error() == fd::kErrorInUse;
      refused = library_->LastError();
      continue;
    }
    unsigned short serial = 0;  // NOLINT(google-runtime-int): as in C
    fd.serial_number(&serial, static_cast<char>(id));
    const std::string its = std::to_string(serial);
    if (!chosen && (options_.serial.empty() || options_.serial == its)) {
      chosen = static_cast<char>(id);
    } else {
      fd.close(static_cast<char>(id));
    }
    others += (others.empty() ? "" : ", ") + its;
  }
  if (chosen && (!options_.serial.empty() || others.find(',') == std::string::npos)) return *chosen;
  if (chosen) {
    fd.close(*chosen);
    throw BusError(BusFault::kAmbiguous, "several are plugged in, with the serial numbers " +
                                             others + ": set [device] serial to one of them");
  }
  if (is_in_use) {
    throw BusError(BusFault::kBusy,
                   "another program uses the device: end it (another palpated, the vendor's "
                   "HapticDesk)");
  }
  if (!refused.empty()) throw BusError(BusFault::kBroken, "cannot open the device: " + refused);
  throw BusError(BusFault::kAbsent,
                 "not found with serial number " + options_.serial + ": plugged in are " + others);
}

void ForceDimensionBus::RequestCalibration() {
  if (!spec_.calibration_moves_arm) {
    throw Error(ErrorKind::kInvalidArgument,
                fmt::format("an {} is calibrated by hand: put the calibration pole into its pit",
                            model_.name));
  }
  exchange_.calibration_wanted = true;
}

}  // namespace palpate
