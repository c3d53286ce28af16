// What the host of a virtual machine took of its processors meanwhile: printed, so that a failed
// test of times can be judged. Threads: one.
#pragma once

#include <cstdio>
#include <fstream>
#include <string>

namespace palpate::load {

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
