// palpate-view in a window, and without one for scripts.
//
// Threads: main, as GLFW requires. Errors: kUnavailable (no display, no OpenGL 4.3; offscreen also
// no palpated); offscreen also kFailedPrecondition (no contact), kCancelled (a signal), kTooLarge
// (the graphics card cannot hold the picture), and those of WritePng.
#pragma once

#include "client/view/viewer/options.h"

namespace palpate::view {

// Runs until the window is closed, a signal comes, or the time is over. If there is a time limit,
// it then prints on stdout what was drawn after everything had arrived, as RunOffscreen does.
void RunWindow(const Options& options);

// Waits until everything to show has arrived, draws, and prints a summary on stdout.
void RunOffscreen(const Options& options);

}  // namespace palpate::view
