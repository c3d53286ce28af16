// An HD library for tests: a module with the functions that are used of it, run by
// what a test sets and telling what it saw. It keeps the library's order strictly and
// notes each breach.
//
// Threads: the scheduler's own calls the callback; a test holds the mutex to look.
#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <string>
#include <vector>

namespace palpate {

struct FakeHd {
  static constexpr const char* kInstance = "FakeHdInstance";
  using Instance = FakeHd* (*)();

  std::mutex mutex;

  // What it does.
  unsigned int init_error = 0;
  bool init_gives_handle = false;  // in spite of the error
  unsigned int init_handle = 0;    // 0: the next number
  unsigned int rate_error = 0;
  unsigned int start_error = 0;
  unsigned int unplugged_error = 0;    // of every frame
  std::vector<unsigned int> errors{};  // of the next frame, each once
  double max_force_n = 3.3;
  int calibration_style = 4;  // inkwell
  unsigned int calibration = 0x5000;
  bool hangs_in_stop = false;
  bool stands_still = false;  // no frames
  std::array<double, 3> position{1.0, 2.0, 3.0};
  bool counts_in_position = false;  // all three are the number of the frame
  std::array<double, 16> transform{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1};
  int buttons = 0;
  unsigned char inkwell_switch = 1;         // out of it
  std::vector<unsigned int> error_stack{};  // not yet taken, newest last

  // What it saw.
  std::vector<std::string> calls{};  // but those of frames
  std::vector<std::string> breaches{};
  std::string device_name{"none was asked for"};
  std::uint64_t frames = 0;
  std::uint64_t inits = 0;
  std::uint64_t calibration_updates = 0;
  std::array<double, 3> force{};  // of the newest frame that ended
  std::uint64_t frames_with_force = 0;
  std::uint64_t zero_frames_at_end = 0;  // in a row, up to now
};

}  // namespace palpate
