// The emergency stop, and what became of it: said when it is known, not when it is asked.
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
  // `urgent`: commands that wait behind nothing else; outlives it.
  explicit EmergencyStop(Commands& urgent);

  // Takes all forces away. Where one is under way already, at most one more waits.
  void Send();
  // Once per frame: what was said holds for the connection that it was said of.
  void Follow(client::ConnectionState connection);

  struct Line {
    std::string text{};  // empty: nothing was asked for
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
