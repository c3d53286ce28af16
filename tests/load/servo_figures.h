// How well the servo kept its time in a window, from every tick that an observer saw.
//
// Threads: any; pure.
#pragma once

#include <cstdint>
#include <cstdio>
#include <fstream>
#include <span>
#include <string>
#include <vector>

#include "tests/load/clients.h"

namespace palpate::load {

struct ServoFigures {
  std::size_t ticks = 0;        // seen
  double missed_share = 0.0;    // of all ticks of the window
  double wake_up_p99_us = 0.0;  // after the deadline
  double update_p99_us = 0.0;   // of the haptic update
  std::size_t contact_faults = 0;
};

// Where the servo's grid of deadlines lies, in ns modulo its period: all of a run's
// ticks tell. A tick starts at its deadline or later, and most start within a
// microsecond of it.
std::int64_t GridPhaseNs(std::span<const Received> ticks);

// Of the ticks that started in [from_ns, to_ns).
ServoFigures FiguresOf(std::span<const Received> ticks, std::int64_t phase_ns, std::int64_t from_ns,
                       std::int64_t to_ns);

// p from 0 to 1; 0 of nothing.
double Percentile(std::vector<double> values, double p);

// What the host of a virtual machine took of its processors meanwhile: printed, so that a failed
// test of times can be judged.
class StealReport {
 public:
  StealReport() : begin_(Read()) {}
  ~StealReport() {
    const Times end = Read();
    const double all = end.all - begin_.all;
    std::printf("the host took %.1f %% of the processors meanwhile\n",
                all > 0.0 ? 100.0 * (end.stolen - begin_.stolen) / all : 0.0);
  }
  StealReport(const StealReport&) = delete;
  StealReport& operator=(const StealReport&) = delete;

 private:
  // Of all processors since the start, in the kernel's ticks.
  struct Times {
    double stolen = 0.0, all = 0.0;
  };

  static Times Read() {
    constexpr int kFields = 8, kSteal = 7;
    std::ifstream stat("/proc/stat");
    std::string name;
    stat >> name;
    Times times;
    double value = 0.0;
    for (int n = 0; n < kFields && stat >> value; ++n) {
      times.all += value;
      if (n == kSteal) times.stolen = value;
    }
    return times;
  }

  const Times begin_;
};

}  // namespace palpate::load
