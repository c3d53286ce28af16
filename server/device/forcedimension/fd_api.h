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
#pragma once

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
