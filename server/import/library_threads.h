// Ends threads that libraries start before main(). Landlock would not confine them: it confines
// only the calling thread and the threads that this thread starts.
//
// Threads: one.
#pragma once

namespace palpate {

// Ends the known threads: OpenVDB's log library, log4cplus, starts four for asynchronous logging,
// which nothing here uses.
void EndLibraryThreads();

// True if this thread is the only one. Waits up to a second for threads that are about to end. Also
// true without /proc.
bool IsOnlyThread();

}  // namespace palpate
