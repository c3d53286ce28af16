// Counts the frames of a run and the ages of their poses, for scripts and tests.
//
// Threads: that of the frames. Uses 8 bytes per frame: for runs that end.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "client/view/viewer/viewer.h"

namespace palpate::view {

class FrameLog {
 public:
  // Call it just before a frame with the viewer's present state is drawn. The first call begins the
  // run.
  void Add(const Viewer& viewer);

  int frames() const { return frames_; }
  double seconds() const;  // since the first frame began; 0 before that

  // A line of figures: "20 frames in 0.51 s, 1 casts, ..." Ages are in ms, and medians unless
  // stated otherwise.
  std::string Line(const Viewer& viewer) const;

 private:
  using Clock = std::chrono::steady_clock;

  int frames_ = 0;
  Clock::time_point begin_{};
  std::uint64_t casts_before_ = 0;
  std::vector<double> ages_ms_;  // empty over TCP
};

}  // namespace palpate::view
