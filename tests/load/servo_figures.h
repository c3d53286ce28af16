// How well the servo kept its time in a window, from every tick that an observer saw.
//
// Threads: any; pure.
#pragma once

#include <cstdint>
#include <span>
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

}  // namespace palpate::load
