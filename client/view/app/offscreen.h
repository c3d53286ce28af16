// palpate-view without a window, for scripts.
//
// Threads: main. Errors: Error with kUnavailable (no palpated, no OpenGL),
// kFailedPrecondition (no contact), kCancelled (a signal), and as WritePng.
#pragma once

#include "client/view/app/options.h"

namespace palpate::view {

// Waits until all that is shown is there, draws, and says on stdout what was done.
void RunOffscreen(const Options& options);

}  // namespace palpate::view
