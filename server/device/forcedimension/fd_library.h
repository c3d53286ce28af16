// Force Dimension's library: its C interface, how it is loaded, and the models that it drives.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <csignal>
#include <string>
#include <string_view>

#include "common/geometry/wrench.h"
#include "server/device/haptic_device.h"

namespace palpate::fd {

inline constexpr int kTimeGuard = 1;  // of a getter: the call came too early, the values are old
inline constexpr int kSaturated = 2;  // of a setter: the motors cannot do it, scaled down

inline constexpr int kErrorCom = 2;
inline constexpr int kErrorNoDevice = 5;
inline constexpr int kErrorInUse = 20;

// Of dhdGetStatus. How many numbers it writes depends on the version: 15 to 17 so far.
inline constexpr int kStatusRoom = 64;
inline constexpr int kStatusPower = 0;
inline constexpr int kStatusReset = 3;  // it waits for its calibration
inline constexpr int kStatusForce = 5;  // its motors are on
inline constexpr int kStatusForceOffCause = 14;

inline constexpr int kOffByButton = 1;
inline constexpr int kOffByVelocity = 2;
inline constexpr int kOffByWatchdog = 3;
inline constexpr int kOffByUsb = 5;
inline constexpr int kOffByDeadMan = 6;

// The part of Force Dimension's C interface that we use: types, numbers and functions. Only facts;
// the vendor's headers are not in this tree.
//
// Units: m, N, N m, rad. Frame, right-handed: x towards the operator, y to the operator's right, z
// up. Every call names its device by the ID that `open` returned. A result of -1 is an error, and
// 1 and 2 are none.
// Threads: the library takes calls from any thread. A call talks to the device before it returns.
// The last error is the calling thread's.
//
// Sources: the vendor's headers of SDK 3.17.5, the symbols of its library 3.10.0, and drivers that
// others published (CHAI3D, sawForceDimensionSDK, hapticore). We have not checked this on hardware.
struct Functions {
  void (*sdk_version)(int* major, int* minor, int* release, int* revision) = nullptr;
  int (*device_count)() = nullptr;  // with those that other programs use
  int (*open)(char index) = nullptr;
  int (*close)(char) = nullptr;
  const char* (*system_name)(char) = nullptr;
  int (*serial_number)(unsigned short*, char) = nullptr;  // NOLINT(google-runtime-int): as in C
  int (*firmware_version)(double*, char) = nullptr;
  bool (*has_wrist)(char) = nullptr;
  bool (*has_active_wrist)(char) = nullptr;
  bool (*has_gripper)(char) = nullptr;
  bool (*is_left_handed)(char) = nullptr;
  int (*position)(double* x, double* y, double* z, char) = nullptr;
  int (*position_and_frame)(double* x, double* y, double* z, double (*rows)[3], char) = nullptr;
  unsigned int (*buttons)(char) = nullptr;
  int (*set_force)(double fx, double fy, double fz, double tx, double ty, double tz, double gripper,
                   char) = nullptr;
  int (*enable_force)(unsigned char on, char) = nullptr;
  int (*set_brakes)(int on, char) = nullptr;
  int (*set_gravity_compensation)(int on, char) = nullptr;
  int (*set_max_force)(double, char) = nullptr;
  int (*set_max_torque)(double, char) = nullptr;
  int (*set_max_gripper_force)(double, char) = nullptr;
  int (*enable_expert_mode)() = nullptr;  // of the whole process
  int (*disable_expert_mode)() = nullptr;
  int (*set_watchdog)(unsigned char steps, char) = nullptr;
  int (*get_watchdog)(unsigned char* steps, char) = nullptr;
  int (*status)(int* numbers, char) = nullptr;
  int (*emulate_button)(unsigned char on, char) = nullptr;  // of the gripper
  bool (*knows_calibration)(char) = nullptr;                // the next three
  bool (*is_calibrated)(char) = nullptr;
  int (*calibrate)(char) = nullptr;  // moves the arm
  int (*end_calibration)(bool keep_forces, char) = nullptr;
  int (*last_error)() = nullptr;
  const char* (*error_text)(int) = nullptr;
};

}  // namespace palpate::fd

namespace palpate {

// Keeps the program's handlers of SIGINT, SIGTERM and SIGPIPE: the library has code to set some.
// Around what opens a device or moves it.
class KeptSignals {
 public:
  KeptSignals() noexcept;
  ~KeptSignals();
  KeptSignals(const KeptSignals&) = delete;
  KeptSignals& operator=(const KeptSignals&) = delete;

 private:
  static constexpr std::array<int, 3> kSignals = {SIGINT, SIGTERM, SIGPIPE};
  std::array<struct sigaction, 3> kept_{};
};

// Loads Force Dimension's library at run time: libdrd, which has the functions of libdhd, too.
//
// Threads, ownership: as VendorLibrary.
// Errors: Error (kNotFound) if the library or a function is missing, or if it is too old.
class FdLibrary {
 public:
  static constexpr const char* kDefaultPath = "libdrd.so.3";

  // path: a file, or a name for which the loader searches.
  explicit FdLibrary(const std::string& path);

  const fd::Functions& functions() const { return functions_; }
  const std::string& version() const { return version_; }  // "3.17.5"
  // "error 20, the device is in use": the last of this thread.
  std::string LastError() const;

 private:
  void CheckVersion(const std::string& path);

  fd::Functions functions_;
  std::string version_;
};

// Force Dimension's models: what each can do, and where the middle of its workspace is.
//
// Frame: the library's; M: mm, x right, y up, z towards the user.
// Threads: pure functions. Errors: FdModelOf throws Error (kInvalidArgument).
// Source: the figures in CHAI3D's driver. Limits of force and torque are our caution.

inline constexpr VerificationLevel kForceDimensionVerification = VerificationLevel::kNone;

struct FdModel {
  std::string_view name{};  // "omega.6"
  double radius_mm = 0.0;
  double motor_force_n = 0.0;  // what the motors can do, gravity compensation included
  bool has_wrist = false;      // it measures how the handle is turned
  bool has_torque = false;     // the wrist has motors
  bool has_gripper = false;
  bool moves_to_calibrate = false;  // by itself; others are calibrated by hand
  const char* calibration_hint = "";

  std::string_view family() const { return name.substr(0, name.find('.')); }
};

const FdModel& FdModelOf(std::string_view name);
// "delta.3, omega.3 or ..."
std::string FdModelNames();

// What the library says of a device.
struct FdAbilities {
  std::string system_name{};
  bool has_wrist = false;
  bool has_torque = false;
  bool has_gripper = false;
  bool is_left_handed = false;
};
// The model with these abilities, of the family in the system's name; null: none that we know.
const FdModel* FdModelWith(const FdAbilities& abilities);

DeviceDescription FdSpec(const FdModel& model);

// The middle of the workspace, in m.
Vec3 FdCentre(const FdModel& model, bool is_left_handed);

// The library's axes in M. A rotation: nothing is mirrored.
inline Vec3 FdToM(const Vec3& v) { return {v.y(), v.z(), v.x()}; }
inline Vec3 FdFromM(const Vec3& v) { return {v.z(), v.x(), v.y()}; }
// The handle's axes to M. A handle at rest points away from the user, as a stylus of the Omni does.
Eigen::Quaterniond FdHandleToM(const Eigen::Matrix3d& handle);

}  // namespace palpate
