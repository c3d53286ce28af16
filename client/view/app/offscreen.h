// palpate-view without a window, for scripts.
//
// Threads: main. Errors: kUnavailable (no palpated, no OpenGL), kFailedPrecondition (no contact),
// kCancelled (a signal), and those of WritePng.
#pragma once

#include "client/view/app/options.h"

namespace palpate::view {

// Waits until everything to show has arrived, draws, and prints a summary on stdout.
void RunOffscreen(const Options& options);

}  // namespace palpate::view
