// Limits wrong logins per address, so that a short key cannot be found by trying.
//
// Right logins do not count: a whole lecture hall may come from one address.
//
// Threads: one.
#pragma once

#include <chrono>
#include <cstddef>
#include <map>
#include <string>
#include <string_view>

#include "client/web/access/sessions.h"

namespace palpate::web {

class LoginAttempts {
 public:
  static constexpr int kMostAMinute = 10;
  // While so many addresses have failed within a minute, no further address may try.
  static constexpr std::size_t kMostAddresses = 4096;

  bool MayTry(std::string_view address, Time now);
  void Failed(std::string_view address, Time now);

 private:
  void BeginAnew(Time now);

  Time begin_{};                                    // of the minute that is counted
  std::map<std::string, int, std::less<>> failed_;  // by address
};

}  // namespace palpate::web
