// The emergency stop and its result. The result is shown when it is known, not when the stop is
// requested.
//
// Threads: any. Errors: none; a stop that did not reach palpated is a state.
#pragma once

#include <memory>
#include <string>

#include "client/sdk/connection.h"
#include "client/view/live/commands.h"

namespace palpate::view {

class EmergencyStop {
 public:
  // `urgent`: no other commands use it, so the stop never waits. It must outlive this object.
  explicit EmergencyStop(Commands& urgent);

  // Removes all forces. If a stop is running already, at most one more waits.
  void Send();
  // Call it once per frame. A shown result is valid only for the connection on which it was
  // received.
  void Follow(client::ConnectionState connection);

  struct Line {
    std::string text{};  // empty: no stop was requested
    bool is_bad = false;
  };
  Line line() const;

 private:
  struct Shared;  // with commands

  Commands& urgent_;
  std::shared_ptr<Shared> shared_;
  client::ConnectionState connection_ = client::ConnectionState::kConnecting;
};

}  // namespace palpate::view
