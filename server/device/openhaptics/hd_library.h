// The vendor's HD library: its C interface, how it is loaded at run time, and what its errors mean.
#pragma once

#include <cstdint>
#include <string>

namespace palpate::hd {

using Handle = unsigned int;
using Enum = unsigned int;
using Boolean = unsigned char;
using SchedulerHandle = unsigned long;  // NOLINT(google-runtime-int): as wide as in C

struct ErrorInfo {
  unsigned int code = 0;
  int internal_code = 0;
  Handle handle = 0;
};

using CallbackCode = unsigned int;
using Callback = CallbackCode (*)(void* user_data);

inline constexpr CallbackCode kCallbackContinue = 1;
inline constexpr std::uint16_t kMaxSchedulerPriority = 0xffff;

inline constexpr Handle kInvalidHandle = 0xffffffff;
// After one failed hdInitDevice, some versions return garbage from the next call and report no
// error. Real handles are small numbers (HAPI's driver, after the vendor's advice).
inline constexpr Handle kGreatestHandle = 1024;

inline constexpr Enum kCurrentButtons = 0x2000;         // int, one bit per button
inline constexpr Enum kCurrentInkwellSwitch = 0x2002;   // boolean, 0: in the inkwell
inline constexpr Enum kCurrentPosition = 0x2050;        // 3 doubles
inline constexpr Enum kCurrentTransform = 0x2052;       // 16 doubles
inline constexpr Enum kDeviceModelType = 0x2501;        // string
inline constexpr Enum kDeviceSerialNumber = 0x2504;     // string
inline constexpr Enum kDeviceFirmwareVersion = 0x2505;  // double
inline constexpr Enum kCalibrationStyle = 0x2555;       // int, one bit per style
inline constexpr Enum kNominalMaxForce = 0x2603;        // double
inline constexpr Enum kCurrentForce = 0x2700;           // 3 doubles

inline constexpr Enum kForceOutput = 0x4000;  // a capability

inline constexpr Enum kCalibrationOk = 0x5000;
inline constexpr Enum kCalibrationNeedsUpdate = 0x5001;
inline constexpr Enum kCalibrationNeedsManualInput = 0x5002;

inline constexpr Enum kStyleEncoderReset = 1;
inline constexpr Enum kStyleAuto = 2;
inline constexpr Enum kStyleInkwell = 4;

// The part of the HD library's C interface that we use: types, numbers and functions. Only facts;
// the vendor's headers are not in this tree.
//
// Units: mm, N, rad. Position, transform and force are in one frame: x right, y up, z towards the
// user. The transform is column-major: its first columns are the stylus's axes, its last column is
// the stylus's position.
//
// Sources, which agree: OpenHaptics Toolkit 3.5.0, API Reference Guide; the bindings pyOpenHaptics
// (hd_define.py) and ManagedPhantom (HdAPI.cs). Column order and stiffness in N/mm: CHAI3D's and
// HAPI's drivers. The inkwell switch reads 0 while the stylus is in the inkwell: HAPI's driver and
// two others. We have not checked this on hardware.
struct Functions {
  Handle (*init_device)(const char* name) = nullptr;  // null: the default device
  void (*disable_device)(Handle) = nullptr;
  // What follows acts on this device, except for what names another one.
  void (*make_current)(Handle) = nullptr;
  void (*begin_frame)(Handle) = nullptr;
  void (*end_frame)(Handle) = nullptr;
  void (*enable)(Enum) = nullptr;
  void (*disable)(Enum) = nullptr;
  void (*get_booleanv)(Enum, Boolean*) = nullptr;
  void (*get_integerv)(Enum, int*) = nullptr;
  void (*get_doublev)(Enum, double*) = nullptr;
  void (*set_doublev)(Enum, const double*) = nullptr;
  const char* (*get_string)(Enum) = nullptr;
  ErrorInfo (*get_error)() = nullptr;  // the newest error not yet taken; code 0: none
  Enum (*check_calibration)() = nullptr;
  void (*update_calibration)(Enum style) = nullptr;
  void (*set_scheduler_rate)(unsigned long hz) = nullptr;  // NOLINT(google-runtime-int)
  SchedulerHandle (*schedule_asynchronous)(Callback, void*, std::uint16_t priority) = nullptr;
  void (*unschedule)(SchedulerHandle) = nullptr;
  void (*start_scheduler)() = nullptr;
  void (*stop_scheduler)() = nullptr;
};

}  // namespace palpate::hd

namespace palpate {

// Loads the vendor's HD library at run time.
//
// Threads: construct on one thread; the functions as the vendor says. Not real-time.
// Ownership, errors: as VendorLibrary.
class HdLibrary {
 public:
  static constexpr const char* kDefaultPath = "libHD.so";

  // path: a file, or a name for which the loader searches.
  explicit HdLibrary(const std::string& path);

  const hd::Functions& functions() const { return functions_; }

 private:
  hd::Functions functions_;
};

}  // namespace palpate

namespace palpate::hd {

// The HD library's error codes, and what each code means for the device.
//
// Threads: pure functions. Real-time: EffectOf does not allocate.
// Source: as above. The effect of each code is our choice.

// In ascending order of weight.
enum class ErrorEffect : std::uint8_t {
  kNone,
  kWarning,  // only reported
  kCall,     // one call was refused; the rest of the frame is good
  kForce,    // the library refused the force: no forces for a while
  kFrame,    // the frame is invalid; if this continues, the device is lost
  kBroken,   // the device is lost
};

ErrorEffect EffectOf(unsigned int code) noexcept;

// "HD_COMM_ERROR (0x302, internal 5): the device does not answer: ...".
std::string Describe(const ErrorInfo& error);

}  // namespace palpate::hd
