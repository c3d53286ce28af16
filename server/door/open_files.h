// Computes how many files this process may have open, and how many of them connections may use.
//
// Threads: main, at start.
#pragma once

namespace palpate {

// Raises the process's limit as far as the system allows; returns the limit.
int RaiseOpenFileLimit();

// New connections with this file number or above are refused. The kernel gives the lowest free
// number, so a connection's number tells how many files are open. The limit allows
// `most_connections` in addition to the daemon's own files. If the limit is low, the number also
// keeps files free for the daemon's own use, recordings and imports.
int FirstRefusedFile(int open_file_limit, int most_connections);

// The lowest number for the second file of a watched connection. It lies above all first files. If
// the limit leaves no room, returns 0 (any number), and watched connections count twice.
int FirstSecondFile(int open_file_limit, int most_connections);

}  // namespace palpate
