// What the importer may reach, whatever makes it try: a link that is put in place after it was
// looked at, or a fault of a library that a hostile file sets off. The kernel refuses the rest, and
// it cannot be taken back.
// - Files: Landlock, Linux 5.13 and later.
// - System calls: seccomp, Linux 4.14 and later; not in sanitizer builds. See system_calls.h.
// A kernel that lacks one of them leaves out what it would refuse.
//
// Errors: Error (kInternal) if the kernel has them and refuses to confine, or if threads run
// already.
#pragma once

#include <filesystem>
#include <vector>

namespace palpate {

// Leaves to read: these files, and folders with all below them; without any, every file. Also the
// system's libraries. Paths that are not there, or have come to hold a link, are left out.
// Leaves to write: descriptors that are open for writing already, such as files in memory and
// pipes. By path nothing can be written, made, renamed or removed.
//
// Call it:
// - before the first thread is started: Landlock holds for this thread and those it starts. The
//   threads of log4cplus, which start before main(), are ended here;
// - after FailAfter() and LimitResources(): timers and limits cannot be set later;
// - after FileStart::Reserve(): files in memory cannot be made later.
void Confine(const std::vector<std::filesystem::path>& readable);

}  // namespace palpate
