// How many files this process may have open, and what of them connections may use.
//
// Threads: main, at start.
#pragma once

namespace palpate {

// Raises the process's own limit as far as the system lets it; returns it.
int RaiseOpenFileLimit();

// The number from which on a new connection is refused. The kernel gives the lowest
// free number, so that a connection's own number tells how many files are open:
// beyond `most_connections` besides the daemon's own, or where those of the daemon
// itself, its recordings and imports, would soon find none.
int FirstRefusedFile(int open_file_limit, int most_connections);

// The number from which on connections that are watched have a second one, above all
// those; 0, any, where the limit leaves no room, so that they count twice.
int FirstSecondFile(int open_file_limit, int most_connections);

}  // namespace palpate
