// Threads that libraries start before main(). Landlock would not hold for them: it confines the
// thread that asks for it, and those that this thread starts.
//
// One thread.
#pragma once

namespace palpate {

// Ends those that are known: OpenVDB's log library, log4cplus, starts four, for a kind of log that
// nothing here uses.
void EndLibraryThreads();

// Whether this thread is the only one. Waits up to a second for threads that are just ending.
// Also true if there is no /proc to look at.
bool IsOnlyThread();

}  // namespace palpate
