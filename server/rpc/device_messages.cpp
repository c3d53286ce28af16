#include "server/rpc/device_messages.h"

#include "common/wire/convert.h"

namespace palpate {
namespace {

v1::VerificationLevel ToProto(VerificationLevel level) {
  switch (level) {
    case VerificationLevel::kNone:
      return v1::VERIFICATION_LEVEL_NONE;
    case VerificationLevel::kEnumerated:
      return v1::VERIFICATION_LEVEL_ENUMERATED;
    case VerificationLevel::kIdentified:
      return v1::VERIFICATION_LEVEL_IDENTIFIED;
    case VerificationLevel::kStateRead:
      return v1::VERIFICATION_LEVEL_STATE_READ;
    case VerificationLevel::kForceVerified:
      return v1::VERIFICATION_LEVEL_FORCE_VERIFIED;
    case VerificationLevel::kSimulated:
      return v1::VERIFICATION_LEVEL_SIMULATED;
  }
  return v1::VERIFICATION_LEVEL_UNSPECIFIED;
}

v1::DeviceConnection ToProto(DeviceConnection connection) {
  switch (connection) {
    case DeviceConnection::kAbsent:
      return v1::DEVICE_CONNECTION_ABSENT;
    case DeviceConnection::kConnecting:
      return v1::DEVICE_CONNECTION_CONNECTING;
    case DeviceConnection::kStreaming:
      return v1::DEVICE_CONNECTION_STREAMING;
  }
  return v1::DEVICE_CONNECTION_UNSPECIFIED;
}

v1::ForceState ToProto(ForceState state) {
  switch (state) {
    case ForceState::kOff:
      return v1::FORCE_STATE_OFF;
    case ForceState::kRampIn:
      return v1::FORCE_STATE_RAMP_IN;
    case ForceState::kOn:
      return v1::FORCE_STATE_ON;
    case ForceState::kHeld:
      return v1::FORCE_STATE_HELD;
    case ForceState::kFault:
      return v1::FORCE_STATE_FAULT;
    case ForceState::kStopped:
      return v1::FORCE_STATE_STOPPED;
  }
  return v1::FORCE_STATE_UNSPECIFIED;
}

v1::ForceReason ToProto(ForceReason reason) {
  switch (reason) {
    case ForceReason::kNone:
      return v1::FORCE_REASON_NONE;
    case ForceReason::kOperator:
      return v1::FORCE_REASON_OPERATOR;
    case ForceReason::kDocked:
      return v1::FORCE_REASON_DOCKED;
    case ForceReason::kUncalibrated:
      return v1::FORCE_REASON_UNCALIBRATED;
    case ForceReason::kStale:
      return v1::FORCE_REASON_STALE;
    case ForceReason::kDeadlines:
      return v1::FORCE_REASON_DEADLINES;
    case ForceReason::kDevice:
      return v1::FORCE_REASON_DEVICE;
    case ForceReason::kPosition:
      return v1::FORCE_REASON_POSITION;
    case ForceReason::kForce:
      return v1::FORCE_REASON_FORCE;
    case ForceReason::kSpeed:
      return v1::FORCE_REASON_SPEED;
    case ForceReason::kStopCall:
      return v1::FORCE_REASON_STOP_CALL;
    case ForceReason::kStopButton:
      return v1::FORCE_REASON_STOP_BUTTON;
  }
  return v1::FORCE_REASON_UNSPECIFIED;
}

}  // namespace

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
  out.set_verification_level(ToProto(spec.verification_level));
  return out;
}

v1::DeviceHealth ToProto(const DeviceHealth& health) {
  v1::DeviceHealth out;
  out.set_connection(ToProto(health.connection));
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
  out.set_verification_level(ToProto(device.verification_level));
  return out;
}

v1::CallerDescription ToProto(const Identity& caller) {
  v1::CallerDescription description;
  description.set_identity(caller.name);
  description.set_role(static_cast<v1::Role>(static_cast<int>(caller.role) + 1));
  return description;
}

v1::ForceStatus ToProto(ForceState state, ForceReason reason, double limit_n) {
  v1::ForceStatus out;
  out.set_state(ToProto(state));
  out.set_reason(ToProto(reason));
  out.set_limit_n(limit_n);
  return out;
}

}  // namespace palpate
