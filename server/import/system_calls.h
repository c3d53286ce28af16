// Limits the system calls of the importer. If a hostile file takes over a library, that library can
// neither reach other processes and the network nor attack parts of the kernel that no reader
// needs.
//
// Errors: Error (kInternal) if the kernel has seccomp and refuses. A kernel without seccomp (before
// Linux 4.14) confines nothing here. Sanitizer builds confine nothing either, because the
// sanitizers' runtime forks, traces the process and opens pipes for its report.
#pragma once

namespace palpate {

// Confines all threads, also later ones, permanently. These calls remain:
// - reading files, and writing to descriptors that are already open for writing;
// - memory that holds no code, threads, locks, clocks and signals within the process.
// For calls that only an attacker makes, the kernel ends the process with SIGSYS. All other calls
// fail with EPERM. system_calls.cpp lists both.
void ConfineSystemCalls();

}  // namespace palpate
