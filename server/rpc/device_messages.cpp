#include "server/rpc/device_messages.h"

#include "common/wire/convert.h"

namespace palpate {
v1::DeviceDescription ToProto(const DeviceSpec& spec) {
  v1::DeviceDescription out;
  out.set_kind(spec.kind);
  out.set_model(spec.model);
  *out.mutable_workspace_min_mm() = ToProto(spec.workspace_min_mm);
  *out.mutable_workspace_max_mm() = ToProto(spec.workspace_max_mm);
  out.set_max_force_n(spec.max_force_n);
  out.set_continuous_force_n(spec.continuous_force_n);
  out.set_max_stiffness_n_per_mm(spec.max_stiffness_n_per_mm);
  out.set_position_resolution_mm(spec.position_resolution_mm);
  out.set_button_count(static_cast<std::uint32_t>(spec.button_count));
  out.set_verification_level(static_cast<v1::VerificationLevel>(spec.verification_level));
  return out;
}

v1::DeviceHealth ToProto(const DeviceHealth& health) {
  v1::DeviceHealth out;
  out.set_connection(static_cast<v1::DeviceConnection>(health.connection));
  out.set_docked(health.docked);
  out.set_calibrated(health.calibrated);
  out.set_identity(health.identity);
  out.set_problem(health.problem);
  out.set_readings(health.readings);
  out.set_forces_written(health.forces_written);
  out.set_lost_readings(health.lost_readings);
  out.set_corrupt_frames(health.corrupt_frames);
  out.set_transfer_errors(health.transfer_errors);
  out.set_connections(health.connections);
  out.set_watchdog_zeros(health.watchdog_zeros);
  return out;
}

v1::ListedDevice ToProto(const ListedDevice& device) {
  v1::ListedDevice out;
  out.set_kind(device.kind);
  out.set_model(device.model);
  out.set_port(device.port);
  out.set_usable(device.usable);
  out.set_problem(device.problem);
  out.set_verification_level(static_cast<v1::VerificationLevel>(device.verification_level));
  return out;
}

v1::CallerDescription ToProto(const Identity& caller) {
  v1::CallerDescription description;
  description.set_identity(caller.name);
  description.set_role(static_cast<v1::Role>(caller.role));
  return description;
}

v1::ForceStatus ToProto(ForceState state, ForceReason reason, double limit_n, bool replay) {
  v1::ForceStatus out;
  out.set_state(static_cast<v1::ForceState>(state));
  out.set_reason(static_cast<v1::ForceReason>(reason));
  out.set_limit_n(limit_n);
  // For the safety stage, a replay is no state: it gets zero forces to write.
  if (replay && (state == ForceState::kOn || state == ForceState::kRampIn)) {
    out.set_state(v1::FORCE_STATE_HELD);
    out.set_reason(v1::FORCE_REASON_REPLAY);
  }
  return out;
}

}  // namespace palpate
