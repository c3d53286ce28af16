// The share of the processors that the host gave to others. A test that judges times prints it, so
// that a reader of its output knows what else the machine did.
#pragma once

#include <cstdio>
#include <fstream>
#include <string>

namespace palpate::test {

class StolenShare {
 public:
  StolenShare() = default;
  // Prints the share since the constructor.
  ~StolenShare() {
    const Ticks now = Read();
    const double all = now.all - begin_.all;
    std::printf("the host took %.1f %% of the processors\n",
                all > 0.0 ? 100.0 * (now.stolen - begin_.stolen) / all : 0.0);
  }
  StolenShare(const StolenShare&) = delete;
  StolenShare& operator=(const StolenShare&) = delete;

 private:
  struct Ticks {
    double all = 0.0, stolen = 0.0;
  };
  // Of the first line of /proc/stat: user, nice, system, idle, iowait, irq, softirq, steal.
  static Ticks Read() {
    std::ifstream file("/proc/stat");
    std::string name;
    file >> name;
    Ticks ticks;
    for (int field = 0; field < 8 && file; ++field) {
      file >> ticks.stolen;
      ticks.all += ticks.stolen;
    }
    return ticks;
  }

  const Ticks begin_ = Read();
};

}  // namespace palpate::test
