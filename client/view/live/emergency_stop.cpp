#include "client/view/live/emergency_stop.h"

#include <mutex>

namespace palpate::view {

struct EmergencyStop::Shared {
  std::mutex mutex;
  int under_way = 0;
  Line result;

  void Finish(const Line& line) {
    const std::lock_guard lock(mutex);
    --under_way;
    result = line;
  }
};

EmergencyStop::EmergencyStop(Commands& urgent)
    : urgent_(urgent), shared_(std::make_shared<Shared>()) {}

void EmergencyStop::Send() {
  {
    const std::lock_guard lock(shared_->mutex);
    if (shared_->under_way == 2) return;
    ++shared_->under_way;
  }
  urgent_.Do("emergency stop", [shared = shared_](client::Client& client) {
    try {
      client.StopForces();
      shared->Finish({.text = "emergency stop: forces are off"});
    } catch (const Error& error) {
      shared->Finish({.text = std::string("emergency stop NOT sent: ") + error.what() +
                              "; switch the device off",
                      .is_bad = true});
    }
  });
}

void EmergencyStop::Follow(client::ConnectionState connection) {
  if (connection == connection_) return;
  connection_ = connection;
  const std::lock_guard lock(shared_->mutex);
  shared_->result = {};
}

EmergencyStop::Line EmergencyStop::line() const {
  const std::lock_guard lock(shared_->mutex);
  if (shared_->under_way > 0) {
    return {.text = "emergency stop: palpated has not answered yet", .is_bad = true};
  }
  return shared_->result;
}

}  // namespace palpate::view
