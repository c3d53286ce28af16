#include "client/view/live/emergency_stop.h"

namespace palpate::view {

void EmergencyStop::Send() {
  const std::lock_guard lock(mutex_);
  if (under_way_ == 2) return;
  ++under_way_;
  commands_.Do("emergency stop", [this](client::Client& client) {
    try {
      client.StopForces();
      Finish({.text = "emergency stop: forces are off"});
    } catch (const Error& error) {
      Finish({.text = std::string("emergency stop NOT sent: ") + error.what() +
                      "; switch the device off",
              .is_bad = true});
    }
  });
}

void EmergencyStop::Finish(const Line& result) {
  const std::lock_guard lock(mutex_);
  --under_way_;
  result_ = result;
}

void EmergencyStop::Follow(client::ConnectionState connection) {
  if (connection == connection_) return;
  connection_ = connection;
  const std::lock_guard lock(mutex_);
  result_ = {};
}

EmergencyStop::Line EmergencyStop::line() const {
  const std::lock_guard lock(mutex_);
  if (under_way_ == 0) return result_;
  return {.text = "emergency stop: palpated has not answered yet", .is_bad = true};
}

}  // namespace palpate::view
