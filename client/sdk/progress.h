// The progress of a long call.
//
// Threads: plain values.
#pragma once

#include <functional>
#include <string>

namespace palpate::client {

struct Progress {
  std::string stage;      // the current step, such as "reading"; empty: not begun
  double fraction = 0.0;  // of the whole, 0 to 1
  std::string detail{};   // "3.0 of 12.5 MiB"; may be empty
};

// Called on the caller's thread for every message of the daemon, and at least every 50 ms in
// between with the last progress. If it returns false, the call is cancelled and throws kCancelled.
// May be empty.
using ProgressFunction = std::function<bool(const Progress&)>;

}  // namespace palpate::client
