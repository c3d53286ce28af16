// palpate-view in a window.
//
// Threads: main, for GLFW wants that. Errors: Error with kUnavailable where there is no
// display or no OpenGL 4.3.
#pragma once

#include "client/view/app/options.h"

namespace palpate::view {

// Until the window is closed, a signal comes, or the time is over. Where there is such a
// time, it then says on stdout what was drawn since all was there, as RunOffscreen does.
void RunWindow(const Options& options);

}  // namespace palpate::view
