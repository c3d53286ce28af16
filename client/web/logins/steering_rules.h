// Which changes of settings a user may make: only settings that the operator allowed, values in the
// setting's range, and not too many. The emergency stop is everybody's: whoever may watch may stop.
//
// Threads: one.
#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <string>
#include <string_view>

#include "client/web/logins/sessions.h"

namespace palpate::web {

// True if a setting of palpated has this key, such as "isovalue" or "stiffness_n_per_mm"; and for
// "facing", where the patient faces (client/sdk/placement.h).
bool IsSetting(std::string_view key);

class SteeringRules {
 public:
  static constexpr std::size_t kMostASecond = 10;  // of one user, in all sessions together

  // "": the user may set this value now, and the change counts. Otherwise why not, for the user.
  // Flags are 0 or 1, choices the number of their word.
  std::string Refusal(const Session& session, std::string_view key, double value, Time now);

 private:
  // When the last changes were; the oldest is at `next`.
  struct Changes {
    std::array<Time, kMostASecond> times{};
    std::size_t next = 0;
  };
  std::map<std::string, Changes> changes_;  // by user; only those who may steer
};

}  // namespace palpate::web
