// Confines the importer, even if a link is replaced after it was checked, or if a hostile file
// exploits a fault of a library. The kernel refuses every other access. The confinement cannot be
// undone.
// - Files: Landlock, Linux 5.13 and later.
// - System calls: seccomp, Linux 4.14 and later; not in sanitizer builds. See system_calls.h.
// On a kernel that lacks one of them, that part is skipped.
//
// Errors: Error (kInternal) if the kernel has them and refuses to confine, or if other threads
// already run.
#pragma once

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

}  // namespace palpate
