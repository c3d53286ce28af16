// The functions of the Force Dimension library on a FakeDrdRecord.
// PALPATE_FAKE_DRD_MISSING: without one of them. PALPATE_FAKE_DRD_OLD: a version that is too old.
#include "tests/support/fake_drd.h"

#include <signal.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <limits>
#include <mutex>
#include <thread>
#include <utility>

using palpate::test::FakeDrdBreach;
using palpate::test::FakeDrdDevice;
using palpate::test::FakeDrdNowNs;
using palpate::test::FakeDrdRecord;
using palpate::test::kFakeDrdFirstId;

namespace {

enum Error {
  kCom = 2,
  kNoDevice = 5,
  kNotAvailable = 6,
  kExpertModeOff = 9,
  kNotImplemented = 10,
  kIndex = 15,
  kNotEnabled = 19,
  kInUse = 20,
  kInvalid = 21
};

std::atomic<FakeDrdRecord*> current = nullptr;
std::array<std::atomic<int>, 2> calls_inside{};
std::atomic<bool> expert_mode = false;  // of this process: the record only shows it
thread_local int last_error = 0;

int Fail(int error) {
  last_error = error;
  return -1;
}

// Only calls without an ID look for another file: a thread that an earlier test left behind keeps
// the earlier test's record. For the same reason a record stays mapped.
FakeDrdRecord* Find() {
  static std::mutex mutex;
  static std::string mapped;
  const std::lock_guard lock(mutex);
  const char* const path = std::getenv(palpate::test::kFakeDrdVariable);
  if (path == nullptr) return nullptr;
  if (mapped != path) {
    mapped = path;
    current = palpate::test::MapFakeDrd(path);
    expert_mode = false;
  }
  return current;
}

__attribute__((format(printf, 2, 3))) void Breach(FakeDrdRecord* record, const char* format, ...) {
  if (record == nullptr) return;
  ++record->breach_count;
  char text[sizeof(FakeDrdBreach::text)];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  for (const FakeDrdBreach& breach : record->breaches)
    if (breach.written && std::strcmp(breach.text, text) == 0) return;
  const auto slot = static_cast<std::size_t>(record->breach_texts++);
  if (slot >= record->breaches.size()) return;
  std::memcpy(record->breaches[slot].text, text, sizeof text);
  record->breaches[slot].written = true;
}

int Forbidden(const char* name) {
  Breach(Find(), "%s must not be called", name);
  return Fail(kNotImplemented);
}

void TripIfSilent(FakeDrdDevice& device) {
  // The clock first: a command that arrives after this line cannot seem late.
  const std::int64_t now = FakeDrdNowNs();
  int none = 0;
  if (device.forces_enabled && device.IsWatchdogTripped(now))
    device.force_off_cause.compare_exchange_strong(none, 3);
}

// One call for an ID. It is false if there is no such device any more; the error is set then.
class Call {
 public:
  explicit Call(const char* name, char id, int error_if_lost = kNoDevice)
      : name_(name), record_(current) {
    if (record_ == nullptr) record_ = Find();
    const int error_before = std::exchange(last_error, kNoDevice);
    if (record_ == nullptr) return;
    const int n = id - kFakeDrdFirstId;
    if (n < 0 || n >= 2 || !Device(n).opened || Device(n).owner_pid != getpid()) {
      Breach(record_, "%s: ID %d is not open", name, id);
      return;
    }
    n_ = n;
    device_ = &Device(n);
    if (calls_inside[static_cast<std::size_t>(n)]++ > 0) ++device_->concurrent_calls;
    if (!device_->present && !device_->lost.exchange(true)) {
      // Without its supply the device forgets what the program set.
      device_->forces_enabled = false;
      device_->watchdog_steps = 0;
    }
    is_alive_ = !device_->lost;
    last_error = is_alive_ ? error_before : error_if_lost;
    if (is_alive_) TripIfSilent(*device_);
  }
  ~Call() {
    if (n_ >= 0) --calls_inside[static_cast<std::size_t>(n_)];
  }
  Call(const Call&) = delete;
  Call& operator=(const Call&) = delete;

  explicit operator bool() const { return is_alive_; }
  FakeDrdDevice* operator->() const { return device_; }
  FakeDrdDevice* device() const { return device_; }  // also a lost one; nullptr: none is open
  void Note(const char* what) const { Breach(record_, "%s %s", name_, what); }

 private:
  FakeDrdDevice& Device(int n) { return record_->devices[static_cast<std::size_t>(n)]; }

  const char* name_;
  FakeDrdRecord* record_;
  FakeDrdDevice* device_ = nullptr;
  int n_ = -1;
  bool is_alive_ = false;
};

// A zombie is dead too: a killed daemon that its parent has not waited for yet.
bool IsHeldByAnother(const FakeDrdDevice& device) {
  const int pid = device.owner_pid;
  if (!device.opened || pid == getpid()) return false;
  std::ifstream file("/proc/" + std::to_string(pid) + "/stat");
  std::string stat;
  if (!std::getline(file, stat)) return false;
  const std::size_t name_end = stat.rfind(')');
  return name_end == std::string::npos || stat.substr(name_end, 3) != ") Z";
}

bool IsCounted(const FakeDrdDevice& device) { return device.present && !device.no_permission; }

bool IsAvailable(const FakeDrdDevice& device) {
  return IsCounted(device) && !device.used_by_another && !IsHeldByAnother(device);
}

int Open(FakeDrdRecord& record, std::size_t n) {
  FakeDrdDevice& device = record.devices[n];
  if (!IsAvailable(device)) return Fail(kInUse);
  device.forces_enabled = false;
  device.commanded = false;
  device.needs_drd_stop = false;
  device.in_auto_init = false;
  device.lost = false;
  // These are the library's, so a new program finds the defaults. The watchdog is the firmware's.
  device.gravity_compensation = true;
  device.emulates_button = false;
  device.max_force = device.max_torque = device.max_gripper_force = -1.0;
  device.owner_pid = getpid();
  signal(SIGINT, SIG_IGN);  // the vendor's library has code to do so
  device.opened = true;
  ++device.opens;
  return static_cast<int>(n) + kFakeDrdFirstId;
}

int Count(bool (*is_counted)(const FakeDrdDevice&)) {
  FakeDrdRecord* const record = Find();
  if (record == nullptr) return 0;
  return static_cast<int>(
      std::count_if(record->devices.begin(), record->devices.end(), is_counted));
}

int OpenIndex(const char* name, char index) {
  FakeDrdRecord* const record = Find();
  if (record == nullptr) return Fail(kNoDevice);
  // -1, any device, is the default in C++. Palpate must name the one that it means.
  if (index < 0) Breach(record, "%s of index %d", name, index);
  int counted = 0;
  for (std::size_t n = 0; n < record->devices.size(); ++n)
    if (IsCounted(record->devices[n]) && counted++ == index) return Open(*record, n);
  return Fail(counted == 0 ? kNoDevice : kIndex);
}

int Close(const char* name, char id) {
  const Call call(name, id);
  if (call.device() == nullptr) return -1;
  if (call->forces_enabled) call.Note("with forces enabled");
  if (expert_mode) call.Note("in expert mode");
  // The forces stay as they are: this judges more strictly than a library that ends them.
  call->opened = false;
  call->owner_pid = 0;
  ++call->closes;
  return call ? 0 : -1;
}

int SetExpertMode(bool on) {
  FakeDrdRecord* const record = Find();
  expert_mode = on;
  if (record != nullptr) record->expert_mode = on;
  return 0;
}

int ReadPosition(const Call& call, double* px, double* py, double* pz) {
  ++call->positions_read;
  int ms = call->block_next_ms;
  if (ms > 0 && call->block_next_ms.compare_exchange_strong(ms, 0))
    std::this_thread::sleep_for(std::chrono::milliseconds(ms));
  while (call->block_next_ms < 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  if (!call->present) return Fail(kCom);
  const int result = call->position_result;
  if (result < 0) return Fail(call->position_error);
  if (call->fail_next_positions > 0) {
    --call->fail_next_positions;
    return Fail(kCom);
  }
  *px = call->gives_nan ? std::numeric_limits<double>::quiet_NaN() : call->position[0].load();
  *py = call->position[1];
  *pz = call->position[2];
  return result;
}

int DisableForce(const Call& call) {
  call->forces_enabled = false;
  call->commanded = false;
  call->brakes_on = true;
  return 0;
}

template <class T, class To>
int Get(const char* name, char id, std::atomic<T> FakeDrdDevice::*member, To* to) {
  const Call call(name, id);
  if (!call) return -1;
  *to = static_cast<To>(call.device()->*member);
  return 0;
}

template <class T>
int Set(const char* name, char id, std::atomic<T> FakeDrdDevice::*member, T value) {
  const Call call(name, id);
  if (!call) return -1;
  call.device()->*member = value;
  return 0;
}

bool Is(const char* name, char id, std::atomic<bool> FakeDrdDevice::*member) {
  const Call call(name, id);
  return call && call.device()->*member;
}

}  // namespace

extern "C" {

// The interface with the vendor's types: ushort is std::uint16_t, uchar is unsigned char.

int dhdGetDeviceCount() { return Count(IsCounted); }
int dhdGetAvailableCount() { return Count(IsAvailable); }

int drdOpenID(char index) { return OpenIndex("drdOpenID", index); }
int dhdOpenID(char index) { return OpenIndex("dhdOpenID", index); }

int dhdOpenSerial(int serial) {
  FakeDrdRecord* const record = Find();
  if (record == nullptr) return Fail(kNoDevice);
  for (std::size_t n = 0; n < record->devices.size(); ++n)
    if (IsCounted(record->devices[n]) && record->devices[n].serial == serial)
      return Open(*record, n);
  return Fail(kNoDevice);
}

int dhdClose(char id) { return Close("dhdClose", id); }
int drdClose(char id) { return Close("drdClose", id); }

const char* dhdGetSystemName(char id) {
  const Call call("dhdGetSystemName", id);
  return call ? call->system_name : nullptr;
}

int dhdGetSystemType(char id) {
  int type = -1;
  return Get("dhdGetSystemType", id, &FakeDrdDevice::system_type, &type) < 0 ? -1 : type;
}
int dhdGetSerialNumber(std::uint16_t* serial, char id) {
  return Get("dhdGetSerialNumber", id, &FakeDrdDevice::serial, serial);
}
int dhdGetVersion(double* version, char id) {
  return Get("dhdGetVersion", id, &FakeDrdDevice::firmware, version);
}

void dhdGetSDKVersion(int* major, int* minor, int* release, int* revision) {
  *major = 3;
#ifdef PALPATE_FAKE_DRD_OLD
  *minor = 9;
  *release = 0;
#else
  *minor = 17;
  *release = 5;
#endif
  *revision = 0;
}

bool dhdHasWrist(char id) { return Is("dhdHasWrist", id, &FakeDrdDevice::has_wrist); }
bool dhdHasActiveWrist(char id) {
  return Is("dhdHasActiveWrist", id, &FakeDrdDevice::has_active_wrist);
}
bool dhdHasGripper(char id) { return Is("dhdHasGripper", id, &FakeDrdDevice::has_gripper); }
bool dhdHasActiveGripper(char id) {
  return Is("dhdHasActiveGripper", id, &FakeDrdDevice::has_active_gripper);
}
bool dhdIsLeftHanded(char id) { return Is("dhdIsLeftHanded", id, &FakeDrdDevice::left_handed); }

int dhdGetPosition(double* px, double* py, double* pz, char id) {
  const Call call("dhdGetPosition", id, kCom);
  return call ? ReadPosition(call, px, py, pz) : -1;
}

int dhdGetPositionAndOrientationFrame(double* px, double* py, double* pz, double matrix[3][3],
                                      char id) {
  const Call call("dhdGetPositionAndOrientationFrame", id, kCom);
  const int result = call ? ReadPosition(call, px, py, pz) : -1;
  if (result < 0) return -1;
  for (std::size_t n = 0; n < 9; ++n) {
    // Singular: the second row twice.
    const std::size_t from = call->gives_singular && n >= 6 ? n - 3 : n;
    matrix[n / 3][n % 3] = call->rotation[from];
  }
  return result;
}

unsigned int dhdGetButtonMask(char id) {
  const Call call("dhdGetButtonMask", id, kCom);
  return call ? call->buttons.load() : 0;
}

int dhdGetGripperAngleRad(double* angle, char id) {
  const Call call("dhdGetGripperAngleRad", id, kCom);
  if (!call) return -1;
  if (!call->has_gripper) return Fail(kNotAvailable);
  *angle = call->gripper_angle;
  return 0;
}

#ifndef PALPATE_FAKE_DRD_MISSING
int dhdSetForceAndTorqueAndGripperForce(double fx, double fy, double fz, double tx, double ty,
                                        double tz, double fg, char id) {
  const Call call("dhdSetForceAndTorqueAndGripperForce", id, kCom);
  if (!call) return -1;
  const std::array<double, 7> forces{fx, fy, fz, tx, ty, tz, fg};
  bool is_zero = true;
  for (const double force : forces) {
    is_zero = is_zero && force == 0.0;
    if (std::isfinite(force)) continue;
    call.Note("of a force that is not finite");
    return Fail(kInvalid);
  }
  if (!call->forces_enabled && !is_zero) call.Note("while forces are off");
  if (call->needs_drd_stop) call.Note("after drdAutoInit without drdStop");
  if (call->force_result < 0) return Fail(call->force_error);
  TripIfSilent(*call.device());  // this thread may have been stopped until here
  if (call->IsBraked(FakeDrdNowNs())) ++call->force_calls_while_off;
  for (std::size_t n = 0; n < 3; ++n) {
    call->force[n] = forces[n];
    call->torque[n] = forces[n + 3];
  }
  call->gripper_force = fg;
  call->last_command_ns = FakeDrdNowNs();
  call->commanded = true;
  ++call->forces_set;
  if (!is_zero) ++call->pushes;
  return call->force_result;
}
#endif

int dhdEnableForce(unsigned char on, char id) {
  const Call call("dhdEnableForce", id);
  if (!call) return -1;
  ++(on != 0 ? call->enable_ons : call->enable_offs);
  if (on == 0 && call->off_result < 0) return Fail(kCom);
  if (on == 0) return DisableForce(call);
  // The motors start without the last command: it is from before they were off.
  if (!call->forces_enabled || call->force_off_cause != 0) call->commanded = false;
  call->last_command_ns = FakeDrdNowNs();
  call->force_off_cause = 0;
  call->forces_enabled = true;
  return 0;
}

int dhdStop(char id) {
  const Call call("dhdStop", id);
  if (!call) return -1;
  ++call->stops;
  return DisableForce(call);
}

int dhdSetBrakes(int on, char id) {
  return Set("dhdSetBrakes", id, &FakeDrdDevice::brakes_on, on != 0);
}

int dhdSetGravityCompensation(int on, char id) {
  const Call call("dhdSetGravityCompensation", id);
  if (!call) return -1;
  ++call->gravity_sets;
  call->gravity_compensation = on != 0;
  return 0;
}

int dhdSetMaxForce(double force, char id) {
  return Set("dhdSetMaxForce", id, &FakeDrdDevice::max_force, force);
}
int dhdSetMaxTorque(double torque, char id) {
  return Set("dhdSetMaxTorque", id, &FakeDrdDevice::max_torque, torque);
}
int dhdSetMaxGripperForce(double force, char id) {
  return Set("dhdSetMaxGripperForce", id, &FakeDrdDevice::max_gripper_force, force);
}

int dhdEnableExpertMode() { return SetExpertMode(true); }
int dhdDisableExpertMode() { return SetExpertMode(false); }

int dhdSetWatchdog(unsigned char steps, char id) {
  const Call call("dhdSetWatchdog", id);
  if (!call) return -1;
  if (!expert_mode) {
    call.Note("outside expert mode");
    return Fail(kExpertModeOff);
  }
  if (!call->watchdog_settable) return Fail(kNotImplemented);
  call->watchdog_steps = steps;
  return 0;
}

int dhdGetWatchdog(unsigned char* steps, char id) {
  const Call call("dhdGetWatchdog", id);
  if (!call) return -1;
  const int other = call->watchdog_reads_back;
  *steps = static_cast<unsigned char>(other >= 0 ? other : call->watchdog_steps.load());
  return 0;
}

int dhdGetStatus(int status[], char id) {
  const Call call("dhdGetStatus", id);
  if (!call) return -1;
  ++call->statuses_read;
  if (call->status_result < 0) return Fail(kCom);
  const bool has_forces = !call->IsBraked(FakeDrdNowNs());
  const int cause = call->force_off_cause;
  const bool brakes = !has_forces && (call->brakes_on || cause != 0);
  const bool has_wrist = call->has_wrist, is_reset = call->is_reset;
  const bool is_idle = !has_forces && !brakes && !is_reset;
  const std::array<int, 9> first{
      call->powered, call->connected, 1,      is_reset,
      is_idle,       has_forces,      brakes, has_forces && call->has_active_wrist,
      has_wrist};
  const std::array<int, 8> rest{0, call->gravity_compensation, 1, has_wrist, 0, cause,
                                0, call->initialized};
  for (int n = 0; n < call->status_length; ++n) {
    const auto at = static_cast<std::size_t>(n);
    // A newer library adds numbers that mean nothing to the driver.
    status[n] = at < 9 ? first[at] : at < 17 ? rest[at - 9] : 99;
  }
  return 0;
}

int dhdEmulateButton(unsigned char on, char id) {
  return Set("dhdEmulateButton", id, &FakeDrdDevice::emulates_button, on != 0);
}

bool drdIsSupported(char id) { return Is("drdIsSupported", id, &FakeDrdDevice::is_supported); }
bool drdIsInitialized(char id) { return Is("drdIsInitialized", id, &FakeDrdDevice::initialized); }

int drdAutoInit(char id) {
  const Call call("drdAutoInit", id);
  if (!call) return -1;
  ++call->auto_inits;
  if (call->forces_enabled) call.Note("while forces are on");
  if (!call->is_supported) return Fail(kNotImplemented);
  call->needs_drd_stop = true;
  call->in_auto_init = true;
  // Forces that are switched off end the motion.
  const int offs = call->enable_offs;
  for (int ms = 0; ms < call->auto_init_ms && call->present && call->enable_offs == offs; ms += 10)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  call->in_auto_init = false;
  if (call->enable_offs != offs) return Fail(kNotEnabled);
  call->forces_enabled = true;  // it holds the arm, until drdStop or somebody ends that
  call->last_command_ns = FakeDrdNowNs();
  if (!call->present) return Fail(kCom);
  const int result = call->auto_init_result;
  if (result < 0) return Fail(call->auto_init_error);
  call->initialized = true;
  call->is_reset = false;
  return result;
}

int drdStop(bool keep_forces, char id) {
  const Call call("drdStop", id);
  if (!call) return -1;
  ++call->drd_stops;
  call->needs_drd_stop = false;
  return keep_forces ? 0 : DisableForce(call);
}

int dhdErrorGetLast() { return last_error; }

const char* dhdErrorGetStr(int error) {
  static constexpr std::array<const char*, 23> kTexts{
      "fine",           "failed",           "no exchange",  "busy",      "no driver",
      "no device",      "not available",    "too late",     "geometry",  "expert mode is off",
      "not in here",    "no memory",        "not ready",    "no file",   "configuration",
      "no such index",  "deprecated",       "null pointer", "redundant", "not enabled",
      "held elsewhere", "invalid argument", "no regulation"};
  return error >= 0 && error < 23 ? kTexts[static_cast<std::size_t>(error)] : "no such error";
}

// Palpate must never call these. Their arguments do not matter.
int dhdSetVelocityThreshold() { return Forbidden("dhdSetVelocityThreshold"); }
int drdStart() { return Forbidden("drdStart"); }
int dhdSetMot() { return Forbidden("dhdSetMot"); }
int dhdEnableSimulator() { return Forbidden("dhdEnableSimulator"); }

}  // extern "C"
