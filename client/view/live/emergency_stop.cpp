#include "client/view/live/emergency_stop.h"

namespace palpate::view {
namespace {

// A palpated that ends answers that they are off.
bool AreOff(client::ForceState state) {
  return state == client::ForceState::kStopped || state == client::ForceState::kOff;
}

// What the newest pose tells; it may be older than the stop.
std::string ForcesNow(const client::Client& client) {
  const std::optional<client::Pose> pose = client.NewestPose();
  const bool is_connected = client.connection().state == client::ConnectionState::kConnected;
  if (is_connected && pose && AreOff(pose->forces.state)) return "forces are off";
  return "switch the device off";
}

}  // namespace

void EmergencyStop::Send() {
  const std::lock_guard lock(mutex_);
  if (under_way_ == 2) return;
  ++under_way_;
  commands_.Do("emergency stop", [this](client::Client& client) {
    try {
      const client::ForceStatus forces = client.StopForces().forces;
      Finish({.text = "emergency stop: " + (AreOff(forces.state)
                                                ? "forces are off"
                                                : std::string(Describe(forces.state).says)),
              .is_bad = !AreOff(forces.state)});
    } catch (const Error& error) {
      Finish({.text = std::string("emergency stop NOT confirmed: ") + error.what() + "; " +
                      ForcesNow(client),
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
