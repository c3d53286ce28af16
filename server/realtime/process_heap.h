// The heap of palpated: jemalloc, which keeps nobody waiting while gigabytes are freed.
//
// glibc's malloc gives freed memory back only by malloc_trim, which holds the heap's lock for 200
// ms per GiB. Every thread that allocates waits, also the one that answers an emergency stop.
//
// A program that links palpate::heap has this heap. Freed memory goes back to the system within a
// second, also where all memory is locked (thread_setup.h); that needs Linux 5.18.
// Threads: any ordinary one.
#pragma once

namespace palpate {

// Gives all freed memory back now, but for what jemalloc's own thread is giving back. Does nothing
// in programs with another heap (tests, sanitizer builds).
void ReturnFreedMemory() noexcept;

}  // namespace palpate
