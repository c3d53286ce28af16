// How far a long call has come.
//
// Threads: plain values.
#pragma once

#include <functional>
#include <string>

namespace palpate::client {

struct Progress {
  std::string stage;      // what is being done, such as "reading"; empty: it has not begun
  double fraction = 0.0;  // of the whole, 0 to 1
  std::string detail{};   // "3.0 of 12.5 MiB"; may be empty
};

// Runs on the thread of the caller: for every message of the daemon and at least every 50 ms in
// between, then with what it had before. False cancels the call, which throws kCancelled.
// May be empty.
using ProgressFunction = std::function<bool(const Progress&)>;

}  // namespace palpate::client
