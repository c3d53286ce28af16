// Confines the importer, even if a link is replaced after it was checked, or if a hostile file
// exploits a fault of a library. The kernel refuses every other access. The confinement cannot be
// undone.
// - Files: Landlock, Linux 5.13 and later.
// - System calls: seccomp, Linux 4.14 and later; not in sanitizer builds.
// On a kernel that lacks one of them, that part is skipped. Also limits what the process may use.
//
// Errors: Error (kInternal) if the kernel has them and refuses to confine, or if other threads
// already run.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

namespace palpate {

// Afterwards the process can read these files, these folders with all below them, and the system's
// libraries. If `readable` is empty, it can read every file. Paths that do not exist, or that now
// hold a link, are left out.
// The process can write only to descriptors that are already open for writing, such as files in
// memory and pipes. By path it cannot write, make, rename or remove anything.
//
// Call it:
// - before the first thread is started: Landlock holds for this thread and the threads that it
//   starts. Confine ends the threads of log4cplus, which start before main();
// - after FailAfter() and LimitResources(): timers and limits cannot be set later.
void Confine(const std::vector<std::filesystem::path>& readable);

// So that a hostile file cannot harm the machine. Limits the calling process permanently: private
// writable memory (the present use, its threads' stacks and `max_memory_bytes`; beyond it
// std::bad_alloc), processor time, size of written files (beyond it a write fails), open files,
// threads (not root's), and no core dump. Gives way. Throws Error (kInternal).
void LimitResources(std::int64_t max_memory_bytes, std::int64_t max_seconds);

// Gives way to other processes, such as the haptic loop. If memory runs out, the kernel ends this
// process before palpated.
void GiveWay();

}  // namespace palpate
