// palpate-view in a window, and without one for scripts; and the frames of such a run.
//
// Threads: main, as GLFW requires. Errors: kUnavailable (no display, no OpenGL 4.3; offscreen also
// no palpated); offscreen also kFailedPrecondition (no contact), kCancelled (a signal), kTooLarge
// (the graphics card cannot hold the picture), and those of WritePng.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "client/view/viewer/options.h"
#include "client/view/viewer/viewer.h"

namespace palpate::view {

// Counts the frames of a run and the ages of their poses, for scripts and tests.
//
// Threads: that of the frames. Uses 8 bytes per frame: for runs that end.
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

// Runs until the window is closed, a signal comes, or the time is over. If there is a time limit,
// it then prints on stdout what was drawn after everything had arrived, as RunOffscreen does.
void RunWindow(const Options& options);

// Waits until everything to show has arrived, draws, and prints a summary on stdout.
void RunOffscreen(const Options& options);

}  // namespace palpate::view
