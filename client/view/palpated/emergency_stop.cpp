#include "client/view/palpated/emergency_stop.h"

namespace palpate::view {
namespace {

// In a line of which nobody is sure. `before`: the newest pose when the stop was sent.
std::string ForcesNow(const client::Client& client, const std::optional<client::Pose>& before) {
  const std::optional<client::Pose> now = client.NewestPose();
  const bool is_newer = now && (!before || now->tick > before->tick);
  if (!is_newer) return "what the forces do is not known: switch the device off";
  if (client::AreOff(now->forces.state)) return "forces are off";
  return std::string(Describe(now->forces.state).says) + ": switch the device off";
}

}  // namespace

void EmergencyStop::Send() {
  const std::lock_guard lock(mutex_);
  if (under_way_ == 2) return;
  ++under_way_;
  commands_.Do("emergency stop", [this](client::Client& client) {
    const std::optional<client::Pose> before = client.NewestPose();
    try {
      const client::ForceStatus forces = client.StopForces().forces;
      Finish({.text = "emergency stop: " + (client::AreOff(forces.state)
                                                ? "forces are off"
                                                : std::string(Describe(forces.state).says)),
              .is_bad = !client::AreOff(forces.state)});
    } catch (const Error& error) {
      Finish({.text = std::string("emergency stop NOT confirmed: ") + error.what() + "; " +
                      ForcesNow(client, before),
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
