// Which system calls the importer may make. A library that a hostile file has taken over can then
// neither reach other processes and the network nor attack the kernel where no reader needs it.
//
// Errors: Error (kInternal) if the kernel has seccomp and refuses. A kernel without seccomp (before
// Linux 4.14) confines nothing here. Sanitizer builds confine nothing either: the sanitizers'
// runtime forks, traces the process and opens pipes to report what it found.
#pragma once

namespace palpate {

// For all threads, those to come included, and for good. What remains:
// - reading files, and writing to descriptors that are open for writing already;
// - memory that holds no code, threads, locks, clocks and signals within the process.
// The kernel answers all else with EPERM, and ends the process with SIGSYS for calls that only an
// attacker makes. system_calls.cpp lists both.
void ConfineSystemCalls();

}  // namespace palpate
