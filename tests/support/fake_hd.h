// An HD library for tests: a module with the HD functions that Palpate uses. Tests set its
// behaviour and read what it saw. It checks the library's required order of calls and notes each
// breach.
//
// In another process, the file that PALPATE_FAKE_HD_HAND names leads its hand: position, buttons
// and the stylus's axes x, y, z, as text. Whoever writes it renames it into its place.
//
// Threads: the scheduler's own thread calls the callback. A test locks the mutex to read.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace palpate {

// One of several devices, by its name.
struct FakeHdDevice {
  unsigned int error = 0;  // returned for each of its frames, with its handle
  bool motors_on = false;
  std::array<double, 3> force{};  // of its newest finished frame
  std::uint64_t frames = 0;
};

struct FakeHdRecord {
  // Its behaviour, set by the test.
  unsigned int init_error = 0;
  bool init_gives_handle = false;  // although there is an error
  unsigned int init_handle = 0;    // 0: the next number
  unsigned int rate_error = 0;
  unsigned int start_error = 0;
  unsigned int unplugged_error = 0;    // returned for every frame
  std::vector<unsigned int> errors{};  // returned for the next frame, each once
  double max_force_n = 3.3;
  int calibration_style = 4;  // inkwell
  unsigned int calibration = 0x5000;
  bool hangs_in_stop = false;
  bool stands_still = false;  // no frames
  std::array<double, 3> position{1.0, 2.0, 3.0};
  bool counts_in_position = false;  // all three coordinates are the number of the frame
  std::array<double, 16> transform{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1};
  int buttons = 0;
  unsigned char inkwell_switch = 1;  // 1: the stylus is out of the inkwell
  std::vector<std::pair<unsigned int, unsigned int>>
      error_stack{};  // not read yet, newest last: code, handle
  std::map<std::string, FakeHdDevice> devices{};

  // What it saw.
  std::vector<std::string> calls{};  // except those within frames
  std::vector<std::string> breaches{};
  std::string device_name{"none was asked for"};
  std::uint64_t frames = 0;
  std::uint64_t inits = 0;
  std::uint64_t forces_set = 0;
  std::uint64_t pushes = 0;  // frames with a force
  std::uint64_t calibration_updates = 0;
  std::array<double, 3> force{};         // of the newest finished frame
  std::uint64_t zero_frames_at_end = 0;  // in a row until now
};

struct FakeHd : FakeHdRecord {
  static constexpr const char* kInstance = "FakeHdInstance";
  using Instance = FakeHd* (*)();

  std::mutex mutex;
};

}  // namespace palpate
