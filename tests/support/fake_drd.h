// A Force Dimension library for tests: a module with the functions of libdrd that Palpate uses. It
// has no code of the vendor.
//
// The devices live in a file that PALPATE_FAKE_DRD names. The module and the test both map the
// file, so a test still sees what a device feels after the test killed or stopped the daemon.
//
// Units: m, N, N m, rad, in the vendor's frame. Times are CLOCK_MONOTONIC, which all processes
// share.
#pragma once

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <new>
#include <stdexcept>
#include <string>
#include <vector>

namespace palpate::test {

inline constexpr const char* kFakeDrdVariable = "PALPATE_FAKE_DRD";
// The ID of a device is its number plus this, so that an index passed as an ID is noticed.
inline constexpr int kFakeDrdFirstId = 3;

inline std::int64_t FakeDrdNowNs() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

struct FakeDrdDevice {
  // Its behaviour, set by the test.
  std::atomic<bool> present = true;
  std::atomic<bool> used_by_another = false;
  std::atomic<bool> no_permission = false;  // not counted, as without the udev rule
  std::atomic<int> serial = 12345;
  std::atomic<double> firmware = 3.1;
  std::atomic<int> system_type = 999;   // a number that no header lists: real devices have such too
  char system_name[32] = "omega.3";     // set before the device is opened
  std::atomic<bool> has_wrist = false;  // a sensed wrist
  std::atomic<bool> has_active_wrist = false;
  std::atomic<bool> has_gripper = false;
  std::atomic<bool> has_active_gripper = false;
  std::atomic<bool> left_handed = false;
  std::array<std::atomic<double>, 3> position{};
  std::array<std::atomic<double>, 9> rotation{1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};  // rows
  std::atomic<unsigned int> buttons = 0;
  std::atomic<double> gripper_angle = 0.0;
  std::atomic<bool> powered = true;
  std::atomic<bool> connected = true;
  std::atomic<bool> is_reset = false;  // waits for calibration
  std::atomic<bool> initialized = true;
  std::atomic<bool> is_supported = true;  // by drd
  std::atomic<int> force_off_cause = 0;   // the firmware's stop; dhdEnableForce(1) clears it
  std::atomic<int> position_result = 0;   // -1: error, 1: recent data
  std::atomic<int> position_error = 2;
  std::atomic<int> fail_next_positions = 0;  // so many, as with position_result -1
  std::atomic<int> status_result = 0;        // -1: error 2
  std::atomic<int> off_result = 0;           // of dhdEnableForce(0), which then does nothing
  std::atomic<int> force_result = 0;         // -1: error, 2: motors saturated
  std::atomic<int> force_error = 2;
  std::atomic<bool> gives_nan = false;
  std::atomic<bool> gives_singular = false;
  std::atomic<int> block_next_ms = 0;        // of the next position call; -1: until it is 0 again
  std::atomic<bool> ignores_enable = false;  // as with a force button that nobody pressed
  std::atomic<bool> watchdog_settable = true;
  std::atomic<int> watchdog_reads_back = -1;  // -1: as it was set
  // More patience than the firmware has, for tests on a busy machine that are not about it.
  std::atomic<std::int64_t> watchdog_slack_ms = 0;
  std::atomic<int> status_length = 16;
  std::atomic<int> auto_init_result = 0;
  std::atomic<int> auto_init_error = 12;
  std::atomic<int> auto_init_ms = 0;

  // What it saw.
  std::array<std::atomic<double>, 3> force{};  // the last command
  std::array<std::atomic<double>, 3> torque{};
  std::atomic<double> gripper_force = 0.0;
  std::atomic<std::int64_t> last_command_ns = 0;  // a force, or forces switched on
  std::atomic<bool> commanded = false;            // a force since forces were switched on
  std::atomic<bool> forces_enabled = false;       // as the program wants it
  std::atomic<bool> brakes_on = false;
  std::atomic<int> watchdog_steps = 0;  // of 125 us; 0: off
  std::atomic<bool> gravity_compensation = true;
  std::atomic<double> max_force = -1.0;  // negative: none. The fake limits nothing itself
  std::atomic<double> max_torque = -1.0;
  std::atomic<double> max_gripper_force = -1.0;
  std::atomic<bool> emulates_button = false;
  std::atomic<bool> opened = false;
  std::atomic<bool> lost = false;  // unplugged since it was opened: its ID stays dead
  std::atomic<int> owner_pid = 0;
  std::atomic<bool> in_auto_init = false;
  std::atomic<bool> needs_drd_stop = false;
  std::atomic<int> opens = 0, closes = 0, positions_read = 0, statuses_read = 0, forces_set = 0,
                   pushes = 0, force_calls_while_off = 0, enable_ons = 0, enable_offs = 0,
                   stops = 0, gravity_sets = 0, auto_inits = 0, drd_stops = 0;
  std::atomic<int> concurrent_calls = 0;  // began while another thread was in a call for it

  bool IsWatchdogTripped(std::int64_t now_ns) const {
    const int steps = watchdog_steps;
    return steps > 0 &&
           now_ns - last_command_ns > steps * std::int64_t{125'000} + watchdog_slack_ms * 1'000'000;
  }
  // The firmware's motors are off, whatever the program believes.
  bool IsBraked(std::int64_t now_ns) const {
    return !present || !powered || !forces_enabled || ignores_enable || force_off_cause != 0 ||
           IsWatchdogTripped(now_ns);
  }
  // The last command stays on the motors when the program dies, unless the watchdog ends it.
  double FeltForceN(int axis, std::int64_t now_ns) const {
    return IsBraked(now_ns) || !commanded ? 0.0 : force.at(static_cast<std::size_t>(axis)).load();
  }
};

struct FakeDrdBreach {
  std::atomic<bool> written = false;
  char text[95] = {};
};

struct FakeDrdRecord {
  FakeDrdRecord() {
    devices[1].present = false;
    devices[1].serial = 54321;
  }

  std::array<FakeDrdDevice, 2> devices;
  std::atomic<bool> expert_mode = false;  // as the last such call of a process left it
  std::atomic<int> breach_count = 0;
  std::atomic<int> breach_texts = 0;
  std::array<FakeDrdBreach, 32> breaches{};  // different texts
};
static_assert(std::atomic<double>::is_always_lock_free &&
              std::atomic<std::int64_t>::is_always_lock_free);

// nullptr if it is no file of a record.
inline FakeDrdRecord* MapFakeDrd(const char* path) {
  const int file = open(path, O_RDWR | O_CLOEXEC);
  if (file < 0) return nullptr;
  struct stat info {};
  void* memory = MAP_FAILED;
  if (fstat(file, &info) == 0 && info.st_size >= static_cast<off_t>(sizeof(FakeDrdRecord)))
    memory = mmap(nullptr, sizeof(FakeDrdRecord), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  close(file);
  return memory == MAP_FAILED ? nullptr : static_cast<FakeDrdRecord*>(memory);
}

// The tests' side. Make it before the daemon starts: the daemon inherits the variable.
class FakeDrd {
 public:
  explicit FakeDrd(const std::filesystem::path& folder) {
    // Another name for each: the module sees by the name that the record is another.
    static std::atomic<int> made = 0;
    path_ = folder / ("fake_drd." + std::to_string(getpid()) + "." + std::to_string(++made));
    std::ofstream(path_).close();
    std::filesystem::resize_file(path_, sizeof(FakeDrdRecord));
    FakeDrdRecord* const memory = MapFakeDrd(path_.c_str());
    if (memory == nullptr) throw std::runtime_error("cannot map " + path_.string());
    record_ = new (memory) FakeDrdRecord;
    setenv(kFakeDrdVariable, path_.c_str(), 1);
  }
  // Lets go of threads that still hang in a call.
  ~FakeDrd() {
    for (FakeDrdDevice& device : record_->devices) {
      device.block_next_ms = 0;
      device.auto_init_ms = 0;
    }
    const char* const now = std::getenv(kFakeDrdVariable);
    if (now != nullptr && path_ == now) unsetenv(kFakeDrdVariable);
    munmap(record_, sizeof(FakeDrdRecord));
  }
  FakeDrd(const FakeDrd&) = delete;
  FakeDrd& operator=(const FakeDrd&) = delete;

  FakeDrdRecord& record() { return *record_; }
  FakeDrdDevice& device(int n = 0) { return record_->devices.at(static_cast<std::size_t>(n)); }

  // Each text once. record().breach_count counts all.
  std::vector<std::string> Breaches() const {
    std::vector<std::string> texts;
    for (const FakeDrdBreach& breach : record_->breaches)
      if (breach.written) texts.emplace_back(breach.text);
    return texts;
  }

 private:
  std::filesystem::path path_;
  FakeDrdRecord* record_ = nullptr;
};

}  // namespace palpate::test
