// Who may watch, and who may change what.
//
// Guests log in by the room's key, which is part of the link that they got. Users whom the operator
// named log in by a token of their own, and may change the settings that the operator allowed.
//
// Threads: the network thread only. Times are given by the caller.
// Errors: the constructor throws kInvalidArgument for options that cannot be used.
#pragma once

#include <chrono>
#include <cstddef>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "client/web/logins/secret.h"
#include "client/web/logins/sessions.h"
#include "client/web/logins/steering_rules.h"

namespace palpate::web {

// Counts wrong logins per address, so that the gateway can answer a flood of them cheaply.
//
// This is no protection against guessing, and right logins pass in any case: a lecture hall may
// come from one address, and some there may have an old link. Guessing is hopeless by itself: a
// room's key has at least 16 characters, and a token 256 random bits.
//
// Threads: one.
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

struct User {
  std::string name;                    // 1 to 64 letters, digits and ._-
  std::string token_sha256_hex;        // 64 hex digits
  std::vector<std::string> may_steer;  // keys of settings
};

struct AccessOptions {
  std::string room_key;  // at least kMinRoomKeyLength characters; empty: guests cannot log in
  std::vector<User> users;
  std::chrono::seconds session_life = std::chrono::hours(12);
};

class Access {
 public:
  static constexpr std::size_t kMinRoomKeyLength = 16;

  explicit Access(AccessOptions options);

  enum class Secret { kRoomKey, kToken };
  // kTooManyAttempts: wrong, too. A right secret is always welcome.
  enum class Result { kWelcome, kWrong, kTooManyAttempts };
  struct Login {
    Result result = Result::kWrong;
    std::string cookie;  // the session's secret
    SessionPtr session;
  };
  // `network`: the browser's address, or its network; see Session.
  Login LogIn(Secret kind, std::string_view secret, std::string_view network, Time now);

  // Null: no such session, or it is over.
  SessionPtr Find(std::string_view cookie, Time now) { return sessions_.Find(cookie, now); }
  void LogOut(std::string_view cookie) { sessions_.Forget(cookie); }

  // See SteeringRules.
  std::string SteeringRefusal(const Session& session, std::string_view key, double value,
                              Time now) {
    return steering_.Refusal(session, key, value, now);
  }

 private:
  struct Known {
    Digest token;
    std::string name;
    std::vector<std::string> may_steer;
  };
  const Known* FindUser(const Digest& token) const;

  bool has_room_ = false;
  Digest room_key_{};
  std::vector<Known> users_;
  Sessions sessions_;
  LoginAttempts attempts_;
  SteeringRules steering_;
  int guests_ = 0;  // that ever came
};

}  // namespace palpate::web
