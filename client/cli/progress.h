// How far a load has come, on stderr.
//
// Threads: main only.
#pragma once

#include <string>
#include <string_view>

namespace palpate::cli {

// On a terminal a bar in place, removed at the end; else a line per stage and per
// quarter.
class ProgressPrinter {
 public:
  ProgressPrinter();
  ~ProgressPrinter();
  ProgressPrinter(const ProgressPrinter&) = delete;
  ProgressPrinter& operator=(const ProgressPrinter&) = delete;

  // `fraction` of the whole, 0 to 1. `detail` alone begins no line.
  void Print(std::string_view stage, double fraction, std::string_view detail = {});

 private:
  const bool is_terminal_;
  bool bar_drawn_ = false;
  std::string stage_;
  int quarter_ = -1;
};

}  // namespace palpate::cli
