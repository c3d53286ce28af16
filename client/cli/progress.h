// Shows the progress of a long call on stderr.
//
// Threads: main only.
#pragma once

#include <chrono>
#include <functional>
#include <string>
#include <string_view>

#include "client/program/interrupt.h"
#include "client/sdk/progress.h"

namespace palpate::cli {

// On a terminal: a bar in place, removed at the end. Otherwise: a line every 2 s.
class ProgressPrinter {
 public:
  using Clock = std::chrono::steady_clock;

  // now: tests pass their own clock.
  explicit ProgressPrinter(std::function<Clock::time_point()> now = Clock::now);
  ~ProgressPrinter();
  ProgressPrinter(const ProgressPrinter&) = delete;
  ProgressPrinter& operator=(const ProgressPrinter&) = delete;

  // `fraction`: of the whole, 0 to 1.
  void Print(std::string_view stage, double fraction, std::string_view detail = {});

 private:
  const bool is_terminal_;
  const std::function<Clock::time_point()> now_;
  bool bar_drawn_ = false;
  Clock::time_point last_line_;
};

// Runs call(progress), such as Calls::LoadVolume, and shows its progress. Ctrl-C and SIGTERM cancel
// the call.
template <class Call>
auto WithProgress(const Call& call) {
  const Interrupt interrupt;
  ProgressPrinter printer;
  return call(client::ProgressFunction([&printer](const client::Progress& progress) {
    if (!progress.stage.empty()) printer.Print(progress.stage, progress.fraction, progress.detail);
    return !Interrupt::IsRaised();
  }));
}

}  // namespace palpate::cli
