// The functions of the HD library on a FakeHd. PALPATE_FAKE_HD_MISSING: without one of
// them.
#include "tests/support/fake_hd.h"

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <thread>

using palpate::FakeHd;
using palpate::FakeHdDevice;

namespace {

struct ErrorInfo {
  unsigned int code;
  int internal_code;
  unsigned int handle;
};
using Callback = unsigned int (*)(void*);

FakeHd fake;
std::map<unsigned int, std::string> set_up;  // names by handle
unsigned int handle = 0;                     // of the current device; 0: none
bool in_frame = false;
std::array<double, 3> next_force{};

Callback callback = nullptr;
void* user_data = nullptr;
std::thread scheduler;
std::atomic<bool> runs{false};

void Note(const char* call) {
  fake.calls.emplace_back(call);
  if (handle == 0) fake.breaches.push_back(std::string(call) + " without a device");
}

void NeedFrame(const char* call) {
  if (!in_frame) fake.breaches.push_back(std::string(call) + " outside of a frame");
}

void FollowHandFile() {
  static const char* const path = std::getenv("PALPATE_FAKE_HD_HAND");
  if (path == nullptr || fake.frames % 8 != 0) return;
  std::ifstream file(path);
  std::array<double, 3> position{};
  int buttons = 0;
  if (!(file >> position[0] >> position[1] >> position[2] >> buttons)) return;
  fake.position = position;
  fake.buttons = buttons;
  for (std::size_t n = 0; n < 9; ++n) file >> fake.transform[n / 3 * 4 + n % 3];
}

FakeHdDevice& Current() { return fake.devices[set_up[handle]]; }

void RunScheduler() {
  auto next = std::chrono::steady_clock::now();
  while (runs) {
    next += std::chrono::milliseconds(1);
    std::this_thread::sleep_until(next);
    Callback now = nullptr;
    {
      const std::lock_guard lock(fake.mutex);
      if (!fake.stands_still) now = callback;
    }
    if (now != nullptr) now(user_data);
  }
}

}  // namespace

extern "C" {

FakeHd* FakeHdInstance() { return &fake; }

unsigned int hdInitDevice(const char* name) {
  const std::lock_guard lock(fake.mutex);
  fake.calls.emplace_back("hdInitDevice");
  ++fake.inits;
  fake.device_name = name != nullptr ? name : "";
  if (runs) fake.breaches.emplace_back("hdInitDevice while the scheduler runs");
  for (const auto& [other, its_name] : set_up) {
    if (its_name == fake.device_name) {
      fake.breaches.emplace_back("hdInitDevice of a device that is set up");
    }
  }
  if (fake.init_error != 0) {
    fake.error_stack.emplace_back(fake.init_error, 0);
    if (!fake.init_gives_handle) return 0xffffffff;
  }
  if (fake.init_handle != 0) return fake.init_handle;
  static unsigned int next_handle = 0;
  handle = ++next_handle;
  set_up[handle] = fake.device_name;
  return handle;
}

void hdMakeCurrentDevice(unsigned int which) {
  const std::lock_guard lock(fake.mutex);
  if (!set_up.contains(which)) fake.breaches.emplace_back("hdMakeCurrentDevice of no device");
  handle = which;
}

void hdDisableDevice(unsigned int which) {
  const std::lock_guard lock(fake.mutex);
  Note("hdDisableDevice");
  if (const auto found = set_up.find(which); found != set_up.end()) {
    // A loop that stands still, or has no device any more, cannot write the last zero.
    if (fake.force != std::array<double, 3>{} && !fake.stands_still && fake.unplugged_error == 0) {
      fake.breaches.emplace_back("hdDisableDevice under a force");
    }
    fake.force = {};  // it has no force then, we assume
    FakeHdDevice& device = fake.devices[found->second];
    device.force = {};
    device.motors_on = false;
    set_up.erase(found);
  } else {
    fake.breaches.emplace_back("hdDisableDevice of no device");
  }
  if (runs) fake.breaches.emplace_back("hdDisableDevice while the scheduler runs");
  if (callback != nullptr) fake.breaches.emplace_back("hdDisableDevice with a callback");
  handle = set_up.empty() ? 0 : set_up.begin()->first;
}

void hdBeginFrame(unsigned int which) {
  const std::lock_guard lock(fake.mutex);
  if (which != handle || handle == 0) fake.breaches.emplace_back("hdBeginFrame of another");
  if (in_frame) fake.breaches.emplace_back("hdBeginFrame in a frame");
  in_frame = true;
  ++fake.frames;
  FollowHandFile();
  next_force = {};
}

void hdEndFrame(unsigned int which) {
  const std::lock_guard lock(fake.mutex);
  NeedFrame("hdEndFrame");
  if (which != handle) fake.breaches.emplace_back("hdEndFrame of another");
  in_frame = false;
  fake.force = next_force;
  FakeHdDevice& device = Current();
  device.force = next_force;
  ++device.frames;
  const bool is_zero = next_force == std::array<double, 3>{};
  fake.pushes += is_zero ? 0 : 1;
  fake.zero_frames_at_end = is_zero ? fake.zero_frames_at_end + 1 : 0;
  if (device.error != 0) fake.error_stack.emplace_back(device.error, which);
  if (fake.unplugged_error != 0) fake.error_stack.emplace_back(fake.unplugged_error, which);
  for (const unsigned int error : fake.errors) fake.error_stack.emplace_back(error, which);
  fake.errors.clear();
}

void hdEnable(unsigned int what) {
  const std::lock_guard lock(fake.mutex);
  Note("hdEnable");
  if (what != 0x4000) fake.breaches.emplace_back("hdEnable of another capability");
  Current().motors_on = true;
}

void hdDisable(unsigned int what) {
  const std::lock_guard lock(fake.mutex);
  Note("hdDisable");
  if (what != 0x4000) fake.breaches.emplace_back("hdDisable of another capability");
  Current().motors_on = false;
}

void hdGetBooleanv(unsigned int name, unsigned char* value) {
  const std::lock_guard lock(fake.mutex);
  NeedFrame("hdGetBooleanv");
  if (name == 0x2002)
    *value = fake.inkwell_switch;
  else
    fake.error_stack.emplace_back(0x0103, handle);
}

void hdGetIntegerv(unsigned int name, int* value) {
  const std::lock_guard lock(fake.mutex);
  if (name == 0x2000) {
    NeedFrame("hdGetIntegerv");
    *value = fake.buttons;
  } else if (name == 0x2555) {
    *value = fake.calibration_style;
  } else {
    fake.error_stack.emplace_back(0x0103, handle);
  }
}

void hdGetDoublev(unsigned int name, double* value) {
  const std::lock_guard lock(fake.mutex);
  if (name == 0x2050) {
    NeedFrame("hdGetDoublev");
    auto position = fake.position;
    if (fake.counts_in_position) position.fill(static_cast<double>(fake.frames));
    std::memcpy(value, position.data(), sizeof position);
  } else if (name == 0x2052) {
    NeedFrame("hdGetDoublev");
    std::memcpy(value, fake.transform.data(), sizeof fake.transform);
  } else if (name == 0x2603) {
    *value = fake.max_force_n;
  } else if (name == 0x2505) {
    *value = 1.25;
  } else {
    fake.error_stack.emplace_back(0x0100, handle);
  }
}

void hdSetDoublev(unsigned int name, const double* value) {
  const std::lock_guard lock(fake.mutex);
  NeedFrame("hdSetDoublev");
  if (name != 0x2700) {
    fake.error_stack.emplace_back(0x0100, handle);
    return;
  }
  next_force = {value[0], value[1], value[2]};
  ++fake.forces_set;
}

const char* hdGetString(unsigned int name) {
  const std::lock_guard lock(fake.mutex);
  if (name == 0x2501) return "Fake Touch";
  if (name == 0x2504) return "12345";
  fake.error_stack.emplace_back(0x0100, handle);
  return nullptr;
}

ErrorInfo hdGetError() {
  const std::lock_guard lock(fake.mutex);
  if (fake.error_stack.empty()) return {0, 0, 0};
  const auto [code, which] = fake.error_stack.back();
  fake.error_stack.pop_back();
  return {code, 7, which};
}

unsigned int hdCheckCalibration() {
  const std::lock_guard lock(fake.mutex);
  return fake.calibration;
}

void hdUpdateCalibration(unsigned int style) {
  const std::lock_guard lock(fake.mutex);
  Note("hdUpdateCalibration");
  if (style != static_cast<unsigned int>(fake.calibration_style)) {
    fake.breaches.emplace_back("hdUpdateCalibration in another style");
  }
  ++fake.calibration_updates;
  fake.calibration = 0x5000;
}

void hdSetSchedulerRate(unsigned long hz) {  // NOLINT(google-runtime-int)
  const std::lock_guard lock(fake.mutex);
  Note("hdSetSchedulerRate");
  if (hz != 1000) fake.breaches.emplace_back("another rate");
  if (fake.rate_error != 0) fake.error_stack.emplace_back(fake.rate_error, handle);
}

#ifndef PALPATE_FAKE_HD_MISSING
unsigned long hdScheduleAsynchronous(Callback what, void* data,  // NOLINT(google-runtime-int)
                                     unsigned short priority) {  // NOLINT(google-runtime-int)
  const std::lock_guard lock(fake.mutex);
  Note("hdScheduleAsynchronous");
  if (priority != 0xffff) fake.breaches.emplace_back("another priority");
  callback = what;
  user_data = data;
  return 0;
}
#endif

void hdUnschedule(unsigned long) {  // NOLINT(google-runtime-int)
  const std::lock_guard lock(fake.mutex);
  Note("hdUnschedule");
  callback = nullptr;
}

void hdStartScheduler() {
  const std::lock_guard lock(fake.mutex);
  Note("hdStartScheduler");
  if (fake.start_error != 0) {
    fake.error_stack.emplace_back(fake.start_error, handle);
    return;
  }
  runs = true;
  scheduler = std::thread(RunScheduler);
}

void hdStopScheduler() {
  for (;;) {
    {
      const std::lock_guard lock(fake.mutex);
      if (!fake.hangs_in_stop) break;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  {
    const std::lock_guard lock(fake.mutex);
    Note("hdStopScheduler");
  }
  runs = false;
  if (scheduler.joinable()) scheduler.join();
}

}  // extern "C"
