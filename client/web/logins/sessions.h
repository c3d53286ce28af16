// Who has logged in: a session for each login, found by the secret in the browser's cookie.
//
// Threads: one.
#pragma once

#include <chrono>
#include <cstddef>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "client/web/logins/secret.h"

namespace palpate::web {

using Time = std::chrono::steady_clock::time_point;

struct Session {
  std::string user;                    // for people and the log
  std::vector<std::string> may_steer;  // keys of settings
  // It logged in from there, and shares limits with all who did. A named user shares with nobody.
  std::string network;
  Time ends;
  bool forgotten = false;  // logged out, or replaced by a newer session

  bool IsOver(Time now) const { return forgotten || now >= ends; }
};
using SessionPtr = std::shared_ptr<const Session>;

class Sessions {
 public:
  // `most`: sessions that are kept. For one more, the one that was used least recently and that
  // nothing else holds is forgotten.
  explicit Sessions(std::chrono::seconds life, std::size_t most = 4096);

  struct Opened {
    std::string secret;  // for the cookie; never kept here
    SessionPtr session;
  };
  Opened Open(std::string user, std::vector<std::string> may_steer, std::string network, Time now);

  // Null: unknown, or over.
  SessionPtr Find(std::string_view secret, Time now);
  // Ends the session for everybody who holds it.
  void Forget(std::string_view secret);
  std::size_t size() const { return kept_.size(); }

 private:
  struct Kept {
    std::shared_ptr<Session> session;
    Time used;
  };
  using Map = std::map<Digest, Kept>;
  void Forget(Map::iterator kept);
  void MakeRoom(Time now);

  const std::chrono::seconds life_;
  const std::size_t most_;
  Map kept_;  // by the SHA-256 of the secret
};

}  // namespace palpate::web
