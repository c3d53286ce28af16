#include "server/device/openhaptics/hd_library.h"

#include <array>
#include <cstdio>

#include "server/device/stream/vendor_library.h"

namespace palpate {

HdLibrary::HdLibrary(const std::string& path) {
  const VendorLibrary library(path, "the vendor's HD library",
                              "install the vendor's OpenHaptics 3 and device driver, or set "
                              "[device] openhaptics_library");
  const auto resolve = [&](const char* name, auto& function) { library.Resolve(name, function); };
  resolve("hdInitDevice", functions_.init_device);
  resolve("hdDisableDevice", functions_.disable_device);
  resolve("hdMakeCurrentDevice", functions_.make_current);
  resolve("hdBeginFrame", functions_.begin_frame);
  resolve("hdEndFrame", functions_.end_frame);
  resolve("hdEnable", functions_.enable);
  resolve("hdDisable", functions_.disable);
  resolve("hdGetBooleanv", functions_.get_booleanv);
  resolve("hdGetIntegerv", functions_.get_integerv);
  resolve("hdGetDoublev", functions_.get_doublev);
  resolve("hdSetDoublev", functions_.set_doublev);
  resolve("hdGetString", functions_.get_string);
  resolve("hdGetError", functions_.get_error);
  resolve("hdCheckCalibration", functions_.check_calibration);
  resolve("hdUpdateCalibration", functions_.update_calibration);
  resolve("hdSetSchedulerRate", functions_.set_scheduler_rate);
  resolve("hdScheduleAsynchronous", functions_.schedule_asynchronous);
  resolve("hdUnschedule", functions_.unschedule);
  resolve("hdStartScheduler", functions_.start_scheduler);
  resolve("hdStopScheduler", functions_.stop_scheduler);
}

}  // namespace palpate

namespace palpate::hd {
namespace {

struct Entry {
  unsigned int code = 0;
  ErrorEffect kind = ErrorEffect::kNone;
  const char* name = "";
  const char* advice = "";
};

constexpr const char* kOurCall = "the library refused a call";
constexpr const char* kTooMuch = "forces are off for half a second";

constexpr std::array<Entry, 22> kEntries = {{
    {0x0000, ErrorEffect::kNone, "HD_SUCCESS", ""},
    {0x0100, ErrorEffect::kCall, "HD_INVALID_ENUM", kOurCall},
    {0x0101, ErrorEffect::kCall, "HD_INVALID_VALUE", kOurCall},
    {0x0102, ErrorEffect::kCall, "HD_INVALID_OPERATION", kOurCall},
    {0x0103, ErrorEffect::kCall, "HD_INVALID_INPUT_TYPE", kOurCall},
    {0x0104, ErrorEffect::kBroken, "HD_BAD_HANDLE", "the library has forgotten the device"},
    {0x0200, ErrorEffect::kWarning, "HD_WARM_MOTORS", "the motors are warm; let them rest"},
    {0x0201, ErrorEffect::kForce, "HD_EXCEEDED_MAX_FORCE", kTooMuch},
    {0x0202, ErrorEffect::kForce, "HD_EXCEEDED_MAX_FORCE_IMPULSE", kTooMuch},
    {0x0203, ErrorEffect::kForce, "HD_EXCEEDED_MAX_VELOCITY", kTooMuch},
    {0x0204, ErrorEffect::kForce, "HD_FORCE_ERROR", kTooMuch},
    {0x0300, ErrorEffect::kBroken, "HD_DEVICE_FAULT", "is the device plugged in and powered?"},
    {0x0301, ErrorEffect::kBroken, "HD_DEVICE_ALREADY_INITIATED", "does another program use it?"},
    {0x0302, ErrorEffect::kFrame, "HD_COMM_ERROR",
     "the device does not answer; check its cables, and its set-up with the vendor's tool"},
    {0x0303, ErrorEffect::kFrame, "HD_COMM_CONFIG_ERROR", "set it up with the vendor's tool"},
    {0x0304, ErrorEffect::kFrame, "HD_TIMER_ERROR", "the library's own loop does not keep time"},
    {0x0400, ErrorEffect::kFrame, "HD_ILLEGAL_BEGIN", kOurCall},
    {0x0401, ErrorEffect::kFrame, "HD_ILLEGAL_END", kOurCall},
    {0x0402, ErrorEffect::kFrame, "HD_FRAME_ERROR", "a frame took too long"},
    {0x0500, ErrorEffect::kCall, "HD_INVALID_PRIORITY", kOurCall},
    {0x0501, ErrorEffect::kCall, "HD_SCHEDULER_FULL", kOurCall},
    {0x0600, ErrorEffect::kBroken, "HD_INVALID_LICENSE", "renew the vendor's licence"},
}};

constexpr Entry kUnknown = {0, ErrorEffect::kCall, "an unknown HD error",
                            "see the vendor's manual"};

const Entry& Find(unsigned int code) noexcept {
  for (const Entry& entry : kEntries) {
    if (entry.code == code) return entry;
  }
  return kUnknown;
}

}  // namespace

ErrorEffect EffectOf(unsigned int code) noexcept { return Find(code).kind; }

std::string Describe(const ErrorInfo& error) {
  const Entry& entry = Find(error.code);
  char numbers[64];
  std::snprintf(numbers, sizeof numbers, " (0x%x, internal %d): ", error.code, error.internal_code);
  return std::string(entry.name) + numbers + entry.advice;
}

}  // namespace palpate::hd
