// palpate-view in a window.
//
// Threads: main, as GLFW requires. Errors: kUnavailable (no display, or no OpenGL 4.3).
#pragma once

#include "client/view/app/options.h"

namespace palpate::view {

// Runs until the window is closed, a signal comes, or the time is over. If there is a time limit,
// it then prints on stdout what was drawn after everything had arrived, as RunOffscreen does.
void RunWindow(const Options& options);

}  // namespace palpate::view
