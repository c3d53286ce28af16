// How many frames a run drew, and how old the poses in them were, for scripts and tests.
//
// Threads: that of the frames. Takes 8 bytes for each frame: for runs that end.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "client/view/app/viewer.h"

namespace palpate::view {

class FrameLog {
 public:
  // The frame of what `viewer` has now is about to be drawn. The first begins the run.
  void Add(const Viewer& viewer);

  int frames() const { return frames_; }
  double seconds() const;  // since the first frame began; 0 before

  // A line of figures: "20 frames in 0.51 s, 1 casts, ..." Ages are medians where nothing
  // else is said, in ms.
  std::string Line(const Viewer& viewer) const;

 private:
  using Clock = std::chrono::steady_clock;

  int frames_ = 0;
  Clock::time_point begin_{};
  std::uint64_t casts_before_ = 0;
  std::vector<double> ages_ms_;  // none over TCP
};

}  // namespace palpate::view
