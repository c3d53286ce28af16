// The heap of palpated: jemalloc, which keeps nobody waiting while gigabytes are freed.
//
// glibc's malloc gives freed memory back only by malloc_trim, which holds the heap's lock for 200
// ms per GiB. Every thread that allocates waits, also the one that answers an emergency stop.
//
// Programs without jemalloc (tests, sanitizer builds) may call these functions: they do nothing.
// Threads: SetUpProcessHeap on the main thread, before other threads; ReturnFreedMemory on any
// ordinary one.
#pragma once

namespace palpate {

// Memory that is freed goes back to the system although all memory is locked (thread_setup.h). This
// needs Linux 5.18.
void SetUpProcessHeap() noexcept;

// Gives all freed memory back now. Otherwise a thread of jemalloc does so within a second.
void ReturnFreedMemory() noexcept;

}  // namespace palpate
