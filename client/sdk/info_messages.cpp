#include "client/sdk/info_messages.h"

#include "common/wire/convert.h"

namespace palpate::client {
namespace {

DeviceInfo DeviceOf(const v1::DeviceDescription& device) {
  DeviceInfo info;
  info.kind = device.kind();
  info.model = device.model();
  info.workspace_min_mm = palpate::FromProto(device.workspace_min_mm());
  info.workspace_max_mm = palpate::FromProto(device.workspace_max_mm());
  info.max_force_n = device.max_force_n();
  info.continuous_force_n = device.continuous_force_n();
  info.max_stiffness_n_per_mm = device.max_stiffness_n_per_mm();
  info.position_resolution_mm = device.position_resolution_mm();
  info.button_count = device.button_count();
  info.verification_level = EnumeratorOf<VerificationLevel>(device.verification_level());
  return info;
}

ServoInfo ServoOf(const v1::ServoDescription& servo) {
  ServoInfo info;
  info.rate_hz = servo.rate_hz();
  info.realtime_scheduling = servo.realtime_scheduling();
  info.memory_locked = servo.memory_locked();
  info.warnings.assign(servo.warnings().begin(), servo.warnings().end());
  info.ticks = servo.ticks();
  info.missed_ticks = servo.missed_ticks();
  info.faulty_ticks = servo.faulty_ticks();
  info.scenes_applied = servo.scenes_applied();
  info.page_faults = servo.page_faults();
  info.lost_samples = servo.lost_samples();
  info.version = servo.version();
  return info;
}

}  // namespace

ForceStatus FromProto(const v1::ForceStatus& forces) {
  return {EnumeratorOf<ForceState>(forces.state()), EnumeratorOf<ForceReason>(forces.reason()),
          forces.limit_n()};
}

DeviceHealth FromProto(const v1::DeviceHealth& health) {
  DeviceHealth result;
  result.connection = EnumeratorOf<DeviceConnection>(health.connection());
  result.docked = health.docked();
  result.calibrated = health.calibrated();
  result.identity = health.identity();
  result.problem = health.problem();
  result.readings = health.readings();
  result.forces_written = health.forces_written();
  result.lost_readings = health.lost_readings();
  result.corrupt_frames = health.corrupt_frames();
  result.transfer_errors = health.transfer_errors();
  result.connections = health.connections();
  result.watchdog_zeros = health.watchdog_zeros();
  return result;
}

DaemonInfo FromProto(const v1::GetDeviceResponse& response) {
  return {DeviceOf(response.device()),  FromProto(response.health()),
          FromProto(response.forces()), response.forces_set_by(),
          response.hand_led_by(),       ServoOf(response.servo()),
          response.caller().identity(), EnumeratorOf<Role>(response.caller().role())};
}

ListedDevice FromProto(const v1::ListedDevice& device) {
  return {device.kind(),    device.model(),
          device.port(),    device.usable(),
          device.problem(), EnumeratorOf<VerificationLevel>(device.verification_level()),
          device.in_use()};
}

Activity FromProto(const v1::GetActivityResponse& response) {
  Activity activity;
  for (const v1::ConnectedCaller& caller : response.callers()) {
    activity.callers.push_back({caller.caller().identity(),
                                EnumeratorOf<Role>(caller.caller().role()), caller.peer(),
                                caller.connected_s(), caller.watches(), caller.is_you()});
  }
  for (const v1::LastChange& change : response.changes()) {
    activity.changes.push_back({change.what(), change.by(), change.ago_s()});
  }
  return activity;
}

SeriesState FromProto(const v1::SeriesState& state, std::optional<std::uint64_t> applied_tick) {
  return {state.frames(), state.position_frames(), state.playing(),      state.rate_hz(),
          state.loop(),   state.interpolate(),     state.memory_bytes(), state.volume_revision(),
          applied_tick};
}

RecordingState FromProto(const v1::RecordingState& state) {
  RecordingState result = {state.running(),    state.path(),  state.ticks(),     state.lost_ticks(),
                           state.size_bytes(), state.error(), state.disk_full(), state.left_out()};
  if (state.has_replay()) {
    const v1::RunningReplay& replay = state.replay();
    result.replay = {replay.by(), replay.path(), replay.ticks(), replay.total_ticks(),
                     replay.speed()};
  }
  return result;
}

v1::ControlSeriesRequest ToProto(const SeriesControl& control) {
  v1::ControlSeriesRequest request;
  if (control.playing) request.set_playing(*control.playing);
  if (control.position_frames) request.set_position_frames(*control.position_frames);
  if (control.rate_hz) request.set_rate_hz(*control.rate_hz);
  if (control.loop) request.set_loop(*control.loop);
  if (control.interpolate) request.set_interpolate(*control.interpolate);
  return request;
}

}  // namespace palpate::client
