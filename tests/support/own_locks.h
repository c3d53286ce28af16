// Holds every lock of this program's own code, and of the log's library, all at once: as if other
// threads held them. Locks of gRPC and of the system are not touched.
//
// Link own_locks.cpp into a program of its own: it stands in front of pthread_mutex_lock.
#pragma once

namespace palpate::test {

// While one exists, own code that wants a lock waits for its end. Code that tries a lock fails.
class AllOwnLocksHeld {
 public:
  AllOwnLocksHeld();
  ~AllOwnLocksHeld();
  AllOwnLocksHeld(const AllOwnLocksHeld&) = delete;
  AllOwnLocksHeld& operator=(const AllOwnLocksHeld&) = delete;

  // How many threads wait.
  static int waiting();
};

}  // namespace palpate::test
