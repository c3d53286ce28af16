// Counts wrong logins per address, so that the gateway can answer a flood of them cheaply.
//
// This is no protection against guessing, and right logins pass in any case: a lecture hall may
// come from one address, and some there may have an old link. Guessing is hopeless by itself: a
// room's key has at least 16 characters, and a token 256 random bits.
//
// Threads: one.
#pragma once

#include <chrono>
#include <cstddef>
#include <map>
#include <string>
#include <string_view>

#include "client/web/logins/sessions.h"

namespace palpate::web {

class LoginAttempts {
 public:
  static constexpr int kMostAMinute = 10;
  // More addresses within a minute are not counted: their attempts are too many at once.
  static constexpr std::size_t kMostAddresses = 4096;

  // Counts a wrong login. False: there were too many from this address within this minute.
  bool IsFew(std::string_view address, Time now);

 private:
  Time begin_{};                                    // of the minute that is counted
  std::map<std::string, int, std::less<>> failed_;  // by address; at most kMostAMinute
};

}  // namespace palpate::web
