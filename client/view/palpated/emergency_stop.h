// The emergency stop and its result. The result is shown when it is known, not when the stop is
// requested.
//
// Threads: any. Errors: none; a stop that did not reach palpated is a state.
#pragma once

#include <mutex>
#include <string>

#include "client/sdk/connection.h"
#include "client/view/palpated/commands.h"

namespace palpate::view {

class EmergencyStop {
 public:
  // `client` must outlive it. The destructor waits for a running stop: see Commands.
  explicit EmergencyStop(client::Client& client) : commands_(client) {}

  // Removes all forces. Never waits for other commands. If a stop is running already, at most one
  // more waits.
  void Send();
  bool is_running() const { return commands_.busy(); }
  // Call it once per frame. A shown result is valid only for the connection on which it was
  // received.
  void Follow(client::ConnectionState connection);

  struct Line {
    std::string text{};  // empty: no stop was requested
    bool is_bad = false;
  };
  Line line() const;

 private:
  void Finish(const Line& result);

  mutable std::mutex mutex_;
  int under_way_ = 0;
  Line result_;
  client::ConnectionState connection_ = client::ConnectionState::kConnecting;
  Commands commands_;  // last: its thread uses the others
};

}  // namespace palpate::view
