// Written by proto/generate from palpate/v1/*.proto: change those.
#include "common/wire/values.h"

#include "common/error/text.h"
#include "common/wire/convert.h"

namespace palpate {

ForceStatus FromProto(const v1::ForceStatus& message) {
  ForceStatus value;
  value.state = EnumeratorOf<ForceState>(message.state());
  value.reason = EnumeratorOf<ForceReason>(message.reason());
  value.limit_n = message.limit_n();
  value.torque_limit_n_mm = message.torque_limit_n_mm();
  return value;
}

v1::ForceStatus ToProto(const ForceStatus& value) {
  v1::ForceStatus message;
  message.set_state(static_cast<v1::ForceState>(value.state));
  message.set_reason(static_cast<v1::ForceReason>(value.reason));
  message.set_limit_n(value.limit_n);
  message.set_torque_limit_n_mm(value.torque_limit_n_mm);
  return message;
}

ListedDevice FromProto(const v1::ListedDevice& message) {
  ListedDevice value;
  value.kind = message.kind();
  value.model = message.model();
  value.port = message.port();
  value.usable = message.usable();
  value.problem = message.problem();
  value.verification_level = EnumeratorOf<VerificationLevel>(message.verification_level());
  value.in_use = message.in_use();
  value.serial = message.serial();
  return value;
}

v1::ListedDevice ToProto(const ListedDevice& value) {
  v1::ListedDevice message;
  message.set_kind(Utf8(value.kind));
  message.set_model(Utf8(value.model));
  message.set_port(Utf8(value.port));
  message.set_usable(value.usable);
  message.set_problem(Utf8(value.problem));
  message.set_verification_level(static_cast<v1::VerificationLevel>(value.verification_level));
  message.set_in_use(value.in_use);
  message.set_serial(Utf8(value.serial));
  return message;
}

DeviceHealth FromProto(const v1::DeviceHealth& message) {
  DeviceHealth value;
  value.connection = EnumeratorOf<DeviceConnection>(message.connection());
  value.docked = message.docked();
  value.calibrated = message.calibrated();
  value.identity = message.identity();
  value.problem = message.problem();
  value.readings = message.readings();
  value.forces_written = message.forces_written();
  value.lost_readings = message.lost_readings();
  value.corrupt_frames = message.corrupt_frames();
  value.transfer_errors = message.transfer_errors();
  value.connections = message.connections();
  value.watchdog_zeros = message.watchdog_zeros();
  return value;
}

v1::DeviceHealth ToProto(const DeviceHealth& value) {
  v1::DeviceHealth message;
  message.set_connection(static_cast<v1::DeviceConnection>(value.connection));
  message.set_docked(value.docked);
  message.set_calibrated(value.calibrated);
  message.set_identity(Utf8(value.identity));
  message.set_problem(Utf8(value.problem));
  message.set_readings(value.readings);
  message.set_forces_written(value.forces_written);
  message.set_lost_readings(value.lost_readings);
  message.set_corrupt_frames(value.corrupt_frames);
  message.set_transfer_errors(value.transfer_errors);
  message.set_connections(value.connections);
  message.set_watchdog_zeros(value.watchdog_zeros);
  return message;
}

CallerDescription FromProto(const v1::CallerDescription& message) {
  CallerDescription value;
  value.identity = message.identity();
  value.role = EnumeratorOf<Role>(message.role());
  return value;
}

v1::CallerDescription ToProto(const CallerDescription& value) {
  v1::CallerDescription message;
  message.set_identity(Utf8(value.identity));
  message.set_role(static_cast<v1::Role>(value.role));
  return message;
}

DeviceDescription FromProto(const v1::DeviceDescription& message) {
  DeviceDescription value;
  value.kind = message.kind();
  value.model = message.model();
  if (message.has_workspace_min_mm()) value.workspace_min_mm = FromProto(message.workspace_min_mm());
  if (message.has_workspace_max_mm()) value.workspace_max_mm = FromProto(message.workspace_max_mm());
  value.max_force_n = message.max_force_n();
  value.continuous_force_n = message.continuous_force_n();
  value.max_stiffness_n_per_mm = message.max_stiffness_n_per_mm();
  value.position_resolution_mm = message.position_resolution_mm();
  value.button_count = message.button_count();
  value.verification_level = EnumeratorOf<VerificationLevel>(message.verification_level());
  value.max_torque_n_mm = message.max_torque_n_mm();
  value.continuous_torque_n_mm = message.continuous_torque_n_mm();
  value.senses_orientation = message.senses_orientation();
  value.calibration_moves_arm = message.calibration_moves_arm();
  return value;
}

v1::DeviceDescription ToProto(const DeviceDescription& value) {
  v1::DeviceDescription message;
  message.set_kind(Utf8(value.kind));
  message.set_model(Utf8(value.model));
  *message.mutable_workspace_min_mm() = ToProto(value.workspace_min_mm);
  *message.mutable_workspace_max_mm() = ToProto(value.workspace_max_mm);
  message.set_max_force_n(value.max_force_n);
  message.set_continuous_force_n(value.continuous_force_n);
  message.set_max_stiffness_n_per_mm(value.max_stiffness_n_per_mm);
  message.set_position_resolution_mm(value.position_resolution_mm);
  message.set_button_count(value.button_count);
  message.set_verification_level(static_cast<v1::VerificationLevel>(value.verification_level));
  message.set_max_torque_n_mm(value.max_torque_n_mm);
  message.set_continuous_torque_n_mm(value.continuous_torque_n_mm);
  message.set_senses_orientation(value.senses_orientation);
  message.set_calibration_moves_arm(value.calibration_moves_arm);
  return message;
}

ServoDescription FromProto(const v1::ServoDescription& message) {
  ServoDescription value;
  value.rate_hz = message.rate_hz();
  value.realtime_scheduling = message.realtime_scheduling();
  value.memory_locked = message.memory_locked();
  value.warnings.assign(message.warnings().begin(), message.warnings().end());
  value.ticks = message.ticks();
  value.missed_ticks = message.missed_ticks();
  value.scenes_applied = message.scenes_applied();
  value.version = message.version();
  value.faulty_ticks = message.faulty_ticks();
  value.page_faults = message.page_faults();
  value.lost_samples = message.lost_samples();
  return value;
}

v1::ServoDescription ToProto(const ServoDescription& value) {
  v1::ServoDescription message;
  message.set_rate_hz(value.rate_hz);
  message.set_realtime_scheduling(value.realtime_scheduling);
  message.set_memory_locked(value.memory_locked);
  for (const auto& one : value.warnings) message.add_warnings(Utf8(one));
  message.set_ticks(value.ticks);
  message.set_missed_ticks(value.missed_ticks);
  message.set_scenes_applied(value.scenes_applied);
  message.set_version(Utf8(value.version));
  message.set_faulty_ticks(value.faulty_ticks);
  message.set_page_faults(value.page_faults);
  message.set_lost_samples(value.lost_samples);
  return message;
}

EnableForcesResponse FromProto(const v1::EnableForcesResponse& message) {
  EnableForcesResponse value;
  if (message.has_forces()) value.forces = FromProto(message.forces());
  value.applied_tick = message.applied_tick();
  return value;
}

v1::EnableForcesResponse ToProto(const EnableForcesResponse& value) {
  v1::EnableForcesResponse message;
  *message.mutable_forces() = ToProto(value.forces);
  message.set_applied_tick(value.applied_tick);
  return message;
}

GetDeviceResponse FromProto(const v1::GetDeviceResponse& message) {
  GetDeviceResponse value;
  if (message.has_device()) value.device = FromProto(message.device());
  if (message.has_servo()) value.servo = FromProto(message.servo());
  if (message.has_health()) value.health = FromProto(message.health());
  if (message.has_forces()) value.forces = FromProto(message.forces());
  if (message.has_caller()) value.caller = FromProto(message.caller());
  value.forces_set_by = message.forces_set_by();
  value.hand_led_by = message.hand_led_by();
  return value;
}

v1::GetDeviceResponse ToProto(const GetDeviceResponse& value) {
  v1::GetDeviceResponse message;
  *message.mutable_device() = ToProto(value.device);
  *message.mutable_servo() = ToProto(value.servo);
  *message.mutable_health() = ToProto(value.health);
  *message.mutable_forces() = ToProto(value.forces);
  *message.mutable_caller() = ToProto(value.caller);
  message.set_forces_set_by(Utf8(value.forces_set_by));
  message.set_hand_led_by(Utf8(value.hand_led_by));
  return message;
}

Hand FromProto(const v1::Hand& message) {
  Hand value;
  value.hand = message.hand();
  if (message.has_device()) value.device = FromProto(message.device());
  if (message.has_health()) value.health = FromProto(message.health());
  if (message.has_forces()) value.forces = FromProto(message.forces());
  value.forces_set_by = message.forces_set_by();
  value.led_by = message.led_by();
  return value;
}

v1::Hand ToProto(const Hand& value) {
  v1::Hand message;
  message.set_hand(value.hand);
  *message.mutable_device() = ToProto(value.device);
  *message.mutable_health() = ToProto(value.health);
  *message.mutable_forces() = ToProto(value.forces);
  message.set_forces_set_by(Utf8(value.forces_set_by));
  message.set_led_by(Utf8(value.led_by));
  return message;
}

HandsState FromProto(const v1::HandsState& message) {
  HandsState value;
  for (const auto& one : message.hands()) value.hands.push_back(FromProto(one));
  if (message.has_servo()) value.servo = FromProto(message.servo());
  return value;
}

v1::HandsState ToProto(const HandsState& value) {
  v1::HandsState message;
  for (const auto& one : value.hands) *message.add_hands() = ToProto(one);
  *message.mutable_servo() = ToProto(value.servo);
  return message;
}

ConnectedCaller FromProto(const v1::ConnectedCaller& message) {
  ConnectedCaller value;
  if (message.has_caller()) value.caller = FromProto(message.caller());
  value.peer = message.peer();
  value.connected_s = message.connected_s();
  value.watches = message.watches();
  value.is_you = message.is_you();
  return value;
}

v1::ConnectedCaller ToProto(const ConnectedCaller& value) {
  v1::ConnectedCaller message;
  *message.mutable_caller() = ToProto(value.caller);
  message.set_peer(Utf8(value.peer));
  message.set_connected_s(value.connected_s);
  message.set_watches(value.watches);
  message.set_is_you(value.is_you);
  return message;
}

LastChange FromProto(const v1::LastChange& message) {
  LastChange value;
  value.what = message.what();
  value.by = message.by();
  value.ago_s = message.ago_s();
  return value;
}

v1::LastChange ToProto(const LastChange& value) {
  v1::LastChange message;
  message.set_what(Utf8(value.what));
  message.set_by(Utf8(value.by));
  message.set_ago_s(value.ago_s);
  return message;
}

GetActivityResponse FromProto(const v1::GetActivityResponse& message) {
  GetActivityResponse value;
  for (const auto& one : message.callers()) value.callers.push_back(FromProto(one));
  for (const auto& one : message.changes()) value.changes.push_back(FromProto(one));
  return value;
}

v1::GetActivityResponse ToProto(const GetActivityResponse& value) {
  v1::GetActivityResponse message;
  for (const auto& one : value.callers) *message.add_callers() = ToProto(one);
  for (const auto& one : value.changes) *message.add_changes() = ToProto(one);
  return message;
}

SphereShape FromProto(const v1::SphereShape& message) {
  SphereShape value;
  if (message.has_center()) value.center = FromProto(message.center());
  value.radius = message.radius();
  return value;
}

v1::SphereShape ToProto(const SphereShape& value) {
  v1::SphereShape message;
  *message.mutable_center() = ToProto(value.center);
  message.set_radius(value.radius);
  return message;
}

BoxShape FromProto(const v1::BoxShape& message) {
  BoxShape value;
  if (message.has_min()) value.min = FromProto(message.min());
  if (message.has_max()) value.max = FromProto(message.max());
  return value;
}

v1::BoxShape ToProto(const BoxShape& value) {
  v1::BoxShape message;
  *message.mutable_min() = ToProto(value.min);
  *message.mutable_max() = ToProto(value.max);
  return message;
}

CapsuleShape FromProto(const v1::CapsuleShape& message) {
  CapsuleShape value;
  if (message.has_from()) value.from = FromProto(message.from());
  if (message.has_to()) value.to = FromProto(message.to());
  value.radius = message.radius();
  return value;
}

v1::CapsuleShape ToProto(const CapsuleShape& value) {
  v1::CapsuleShape message;
  *message.mutable_from() = ToProto(value.from);
  *message.mutable_to() = ToProto(value.to);
  message.set_radius(value.radius);
  return message;
}

IndexBox FromProto(const v1::IndexBox& message) {
  IndexBox value;
  value.min = Vec3i(FromCount(message.min_x()), FromCount(message.min_y()), FromCount(message.min_z()));
  value.max = Vec3i(FromCount(message.max_x()), FromCount(message.max_y()), FromCount(message.max_z()));
  return value;
}

v1::IndexBox ToProto(const IndexBox& value) {
  v1::IndexBox message;
  message.set_min_x(ToCount(value.min.x()));
  message.set_min_y(ToCount(value.min.y()));
  message.set_min_z(ToCount(value.min.z()));
  message.set_max_x(ToCount(value.max.x()));
  message.set_max_y(ToCount(value.max.y()));
  message.set_max_z(ToCount(value.max.z()));
  return message;
}

EditVolumeResponse FromProto(const v1::EditVolumeResponse& message) {
  EditVolumeResponse value;
  value.volume_revision = message.volume_revision();
  value.applied_tick = message.applied_tick();
  if (message.has_changed()) value.changed = FromProto(message.changed());
  value.changed_voxels = message.changed_voxels();
  value.undo_steps = message.undo_steps();
  value.redo_steps = message.redo_steps();
  return value;
}

v1::EditVolumeResponse ToProto(const EditVolumeResponse& value) {
  v1::EditVolumeResponse message;
  message.set_volume_revision(value.volume_revision);
  message.set_applied_tick(value.applied_tick);
  if (value.changed) *message.mutable_changed() = ToProto(*value.changed);
  message.set_changed_voxels(value.changed_voxels);
  message.set_undo_steps(value.undo_steps);
  message.set_redo_steps(value.redo_steps);
  return message;
}

RunningReplay FromProto(const v1::RunningReplay& message) {
  RunningReplay value;
  value.by = message.by();
  value.path = message.path();
  value.ticks = message.ticks();
  value.total_ticks = message.total_ticks();
  value.speed = message.speed();
  return value;
}

v1::RunningReplay ToProto(const RunningReplay& value) {
  v1::RunningReplay message;
  message.set_by(Utf8(value.by));
  message.set_path(Utf8(value.path));
  message.set_ticks(value.ticks);
  message.set_total_ticks(value.total_ticks);
  message.set_speed(value.speed);
  return message;
}

RecordedMarker FromProto(const v1::RecordedMarker& message) {
  RecordedMarker value;
  value.tick = message.tick();
  value.text = message.text();
  return value;
}

v1::RecordedMarker ToProto(const RecordedMarker& value) {
  v1::RecordedMarker message;
  message.set_tick(value.tick);
  message.set_text(Utf8(value.text));
  return message;
}

RecordedFile FromProto(const v1::RecordedFile& message) {
  RecordedFile value;
  value.path = message.path();
  value.size_bytes = message.size_bytes();
  value.modified_s = message.modified_s();
  return value;
}

v1::RecordedFile ToProto(const RecordedFile& value) {
  v1::RecordedFile message;
  message.set_path(Utf8(value.path));
  message.set_size_bytes(value.size_bytes);
  message.set_modified_s(value.modified_s);
  return message;
}

RecordingState FromProto(const v1::RecordingState& message) {
  RecordingState value;
  value.running = message.running();
  value.path = message.path();
  value.ticks = message.ticks();
  value.lost_ticks = message.lost_ticks();
  value.size_bytes = message.size_bytes();
  value.error = message.error();
  value.left_out = message.left_out();
  if (message.has_replay()) value.replay = FromProto(message.replay());
  value.disk_full = message.disk_full();
  return value;
}

v1::RecordingState ToProto(const RecordingState& value) {
  v1::RecordingState message;
  message.set_running(value.running);
  message.set_path(Utf8(value.path));
  message.set_ticks(value.ticks);
  message.set_lost_ticks(value.lost_ticks);
  message.set_size_bytes(value.size_bytes);
  message.set_error(Utf8(value.error));
  message.set_left_out(Utf8(value.left_out));
  if (value.replay) *message.mutable_replay() = ToProto(*value.replay);
  message.set_disk_full(value.disk_full);
  return message;
}

ReplayResponse FromProto(const v1::ReplayResponse& message) {
  ReplayResponse value;
  value.ticks = message.ticks();
  value.lost_ticks = message.lost_ticks();
  value.marker = message.marker();
  value.total_ticks = message.total_ticks();
  for (const auto& one : message.markers()) value.markers.push_back(FromProto(one));
  return value;
}

v1::ReplayResponse ToProto(const ReplayResponse& value) {
  v1::ReplayResponse message;
  message.set_ticks(value.ticks);
  message.set_lost_ticks(value.lost_ticks);
  message.set_marker(Utf8(value.marker));
  message.set_total_ticks(value.total_ticks);
  for (const auto& one : value.markers) *message.add_markers() = ToProto(one);
  return message;
}

ListRecordingsResponse FromProto(const v1::ListRecordingsResponse& message) {
  ListRecordingsResponse value;
  for (const auto& one : message.recordings()) value.recordings.push_back(FromProto(one));
  value.folder = message.folder();
  return value;
}

v1::ListRecordingsResponse ToProto(const ListRecordingsResponse& value) {
  v1::ListRecordingsResponse message;
  for (const auto& one : value.recordings) *message.add_recordings() = ToProto(one);
  message.set_folder(Utf8(value.folder));
  return message;
}

SurfaceLayer FromProto(const v1::SurfaceLayer& message) {
  SurfaceLayer value;
  value.id = message.id();
  value.name = message.name();
  value.isovalue = message.isovalue();
  value.stiffness_n_per_mm = message.stiffness_n_per_mm();
  value.damping_n_s_per_m = message.damping_n_s_per_m();
  value.static_friction = message.static_friction();
  value.dynamic_friction = message.dynamic_friction();
  value.pop_force_n = message.pop_force_n();
  if (message.has_pop_out_force_n()) value.pop_out_force_n = message.pop_out_force_n();
  value.viscosity_n_s_per_m = message.viscosity_n_s_per_m();
  return value;
}

v1::SurfaceLayer ToProto(const SurfaceLayer& value) {
  v1::SurfaceLayer message;
  message.set_id(value.id);
  message.set_name(Utf8(value.name));
  message.set_isovalue(value.isovalue);
  message.set_stiffness_n_per_mm(value.stiffness_n_per_mm);
  message.set_damping_n_s_per_m(value.damping_n_s_per_m);
  message.set_static_friction(value.static_friction);
  message.set_dynamic_friction(value.dynamic_friction);
  message.set_pop_force_n(value.pop_force_n);
  if (value.pop_out_force_n) message.set_pop_out_force_n(*value.pop_out_force_n);
  message.set_viscosity_n_s_per_m(value.viscosity_n_s_per_m);
  return message;
}

HeldToolBall FromProto(const v1::HeldToolBall& message) {
  HeldToolBall value;
  if (message.has_center_mm()) value.center_mm = FromProto(message.center_mm());
  value.radius_mm = message.radius_mm();
  value.carves = message.carves();
  return value;
}

v1::HeldToolBall ToProto(const HeldToolBall& value) {
  v1::HeldToolBall message;
  *message.mutable_center_mm() = ToProto(value.center_mm);
  message.set_radius_mm(value.radius_mm);
  message.set_carves(value.carves);
  return message;
}

BallState FromProto(const v1::BallState& message) {
  BallState value;
  value.felt_radius_mm = message.felt_radius_mm();
  value.is_awaited = message.is_awaited();
  if (message.has_share_done()) value.share_done = message.share_done();
  value.problem = message.problem();
  return value;
}

v1::BallState ToProto(const BallState& value) {
  v1::BallState message;
  message.set_felt_radius_mm(value.felt_radius_mm);
  message.set_is_awaited(value.is_awaited);
  if (value.share_done) message.set_share_done(*value.share_done);
  message.set_problem(Utf8(value.problem));
  return message;
}

SurfaceLayers FromProto(const v1::SurfaceLayers& message) {
  SurfaceLayers value;
  for (const auto& one : message.layer()) value.layer.push_back(FromProto(one));
  return value;
}

v1::SurfaceLayers ToProto(const SurfaceLayers& value) {
  v1::SurfaceLayers message;
  for (const auto& one : value.layer) *message.add_layer() = ToProto(one);
  return message;
}

HeldTool FromProto(const v1::HeldTool& message) {
  HeldTool value;
  value.name = message.name();
  for (const auto& one : message.ball()) value.ball.push_back(FromProto(one));
  value.rotation_length_mm = message.rotation_length_mm();
  return value;
}

v1::HeldTool ToProto(const HeldTool& value) {
  v1::HeldTool message;
  message.set_name(Utf8(value.name));
  for (const auto& one : value.ball) *message.add_ball() = ToProto(one);
  message.set_rotation_length_mm(value.rotation_length_mm);
  return message;
}

VolumeRevision FromProto(const v1::VolumeRevision& message) {
  VolumeRevision value;
  value.daemon_id = message.daemon_id();
  value.volume_revision = message.volume_revision();
  return value;
}

v1::VolumeRevision ToProto(const VolumeRevision& value) {
  v1::VolumeRevision message;
  message.set_daemon_id(value.daemon_id);
  message.set_volume_revision(value.volume_revision);
  return message;
}

VolumeOverview FromProto(const v1::VolumeOverview& message) {
  VolumeOverview value;
  value.size = Vec3i(FromCount(message.size_x()), FromCount(message.size_y()), FromCount(message.size_z()));
  value.first_block = message.first_block();
  value.zstd_values = message.zstd_values();
  return value;
}

v1::VolumeOverview ToProto(const VolumeOverview& value) {
  v1::VolumeOverview message;
  message.set_size_x(ToCount(value.size.x()));
  message.set_size_y(ToCount(value.size.y()));
  message.set_size_z(ToCount(value.size.z()));
  message.set_first_block(value.first_block);
  message.set_zstd_values(value.zstd_values);
  return message;
}

VolumePlacement FromProto(const v1::VolumePlacement& message) {
  VolumePlacement value;
  if (message.has_device_from_index()) value.device_from_index = FromProto(message.device_from_index());
  value.settings_revision = message.settings_revision();
  value.patient_axes = message.patient_axes();
  value.patient_axes_answered = message.patient_axes_answered();
  value.replayed = message.replayed();
  return value;
}

v1::VolumePlacement ToProto(const VolumePlacement& value) {
  v1::VolumePlacement message;
  *message.mutable_device_from_index() = ToProto(value.device_from_index);
  message.set_settings_revision(value.settings_revision);
  message.set_patient_axes(Utf8(value.patient_axes));
  message.set_patient_axes_answered(value.patient_axes_answered);
  message.set_replayed(value.replayed);
  return message;
}

SuggestedIsovalue FromProto(const v1::SuggestedIsovalue& message) {
  SuggestedIsovalue value;
  value.name = message.name();
  value.isovalue = message.isovalue();
  value.reason = message.reason();
  return value;
}

v1::SuggestedIsovalue ToProto(const SuggestedIsovalue& value) {
  v1::SuggestedIsovalue message;
  message.set_name(Utf8(value.name));
  message.set_isovalue(value.isovalue);
  message.set_reason(Utf8(value.reason));
  return message;
}

ValueHistogram FromProto(const v1::ValueHistogram& message) {
  ValueHistogram value;
  value.low = message.low();
  value.high = message.high();
  value.counts.assign(message.counts().begin(), message.counts().end());
  value.peaks.assign(message.peaks().begin(), message.peaks().end());
  return value;
}

v1::ValueHistogram ToProto(const ValueHistogram& value) {
  v1::ValueHistogram message;
  message.set_low(value.low);
  message.set_high(value.high);
  for (const auto& one : value.counts) message.add_counts(one);
  for (const auto& one : value.peaks) message.add_peaks(one);
  return message;
}

SaveVolumeResult FromProto(const v1::SaveVolumeResult& message) {
  SaveVolumeResult value;
  value.volume_revision = message.volume_revision();
  value.size_bytes = message.size_bytes();
  return value;
}

v1::SaveVolumeResult ToProto(const SaveVolumeResult& value) {
  v1::SaveVolumeResult message;
  message.set_volume_revision(value.volume_revision);
  message.set_size_bytes(value.size_bytes);
  return message;
}

VolumeDescription FromProto(const v1::VolumeDescription& message) {
  VolumeDescription value;
  value.source = message.source();
  value.volume_revision = message.volume_revision();
  value.size = Vec3i(FromCount(message.size_x()), FromCount(message.size_y()), FromCount(message.size_z()));
  if (message.has_spacing_mm()) value.spacing_mm = FromProto(message.spacing_mm());
  value.value_min = message.value_min();
  value.value_max = message.value_max();
  value.unit = message.unit();
  value.original_type = message.original_type();
  value.is_level_set = message.is_level_set();
  if (message.has_world_from_index()) value.world_from_index = FromProto(message.world_from_index());
  if (message.has_device_from_index()) value.device_from_index = FromProto(message.device_from_index());
  value.device_mm_per_volume_mm = message.device_mm_per_volume_mm();
  value.patient_axes = message.patient_axes();
  value.patient_axes_answered = message.patient_axes_answered();
  value.memory_bytes = message.memory_bytes();
  value.unsaved_edits = message.unsaved_edits();
  value.warnings.assign(message.warnings().begin(), message.warnings().end());
  for (const auto& one : message.suggested_isovalues()) value.suggested_isovalues.push_back(FromProto(one));
  value.loaded_revision = message.loaded_revision();
  value.frames = message.frames();
  if (message.has_device_from_world_rotation()) value.device_from_world_rotation = UnalignedQuaternion(FromProto(message.device_from_world_rotation()));
  if (message.has_histogram()) value.histogram = FromProto(message.histogram());
  value.name = message.name();
  value.voxel_type = EnumeratorOf<VoxelType>(message.voxel_type());
  value.window_level = message.window_level();
  value.window_width = message.window_width();
  value.replayed = message.replayed();
  return value;
}

v1::VolumeDescription ToProto(const VolumeDescription& value) {
  v1::VolumeDescription message;
  message.set_source(Utf8(value.source));
  message.set_volume_revision(value.volume_revision);
  message.set_size_x(ToCount(value.size.x()));
  message.set_size_y(ToCount(value.size.y()));
  message.set_size_z(ToCount(value.size.z()));
  *message.mutable_spacing_mm() = ToProto(value.spacing_mm);
  message.set_value_min(value.value_min);
  message.set_value_max(value.value_max);
  message.set_unit(Utf8(value.unit));
  message.set_original_type(Utf8(value.original_type));
  message.set_is_level_set(value.is_level_set);
  *message.mutable_world_from_index() = ToProto(value.world_from_index);
  *message.mutable_device_from_index() = ToProto(value.device_from_index);
  message.set_device_mm_per_volume_mm(value.device_mm_per_volume_mm);
  message.set_patient_axes(Utf8(value.patient_axes));
  message.set_patient_axes_answered(value.patient_axes_answered);
  message.set_memory_bytes(value.memory_bytes);
  message.set_unsaved_edits(value.unsaved_edits);
  for (const auto& one : value.warnings) message.add_warnings(Utf8(one));
  for (const auto& one : value.suggested_isovalues) *message.add_suggested_isovalues() = ToProto(one);
  message.set_loaded_revision(value.loaded_revision);
  message.set_frames(value.frames);
  *message.mutable_device_from_world_rotation() = ToProto(Eigen::Quaterniond(value.device_from_world_rotation));
  *message.mutable_histogram() = ToProto(value.histogram);
  message.set_name(Utf8(value.name));
  message.set_voxel_type(static_cast<v1::VoxelType>(value.voxel_type));
  message.set_window_level(value.window_level);
  message.set_window_width(value.window_width);
  message.set_replayed(value.replayed);
  return message;
}

LoadVolumeResult FromProto(const v1::LoadVolumeResult& message) {
  LoadVolumeResult value;
  if (message.has_volume()) value.volume = FromProto(message.volume());
  value.applied_tick = message.applied_tick();
  value.settings_revision = message.settings_revision();
  value.isovalue = message.isovalue();
  return value;
}

v1::LoadVolumeResult ToProto(const LoadVolumeResult& value) {
  v1::LoadVolumeResult message;
  *message.mutable_volume() = ToProto(value.volume);
  message.set_applied_tick(value.applied_tick);
  message.set_settings_revision(value.settings_revision);
  message.set_isovalue(value.isovalue);
  return message;
}

SeriesState FromProto(const v1::SeriesState& message) {
  SeriesState value;
  value.frames = message.frames();
  value.position_frames = message.position_frames();
  value.playing = message.playing();
  value.rate_hz = message.rate_hz();
  value.loop = message.loop();
  value.interpolate = message.interpolate();
  value.memory_bytes = message.memory_bytes();
  value.volume_revision = message.volume_revision();
  value.replayed = message.replayed();
  return value;
}

v1::SeriesState ToProto(const SeriesState& value) {
  v1::SeriesState message;
  message.set_frames(value.frames);
  message.set_position_frames(value.position_frames);
  message.set_playing(value.playing);
  message.set_rate_hz(value.rate_hz);
  message.set_loop(value.loop);
  message.set_interpolate(value.interpolate);
  message.set_memory_bytes(value.memory_bytes);
  message.set_volume_revision(value.volume_revision);
  message.set_replayed(value.replayed);
  return message;
}

ControlSeriesRequest FromProto(const v1::ControlSeriesRequest& message) {
  ControlSeriesRequest value;
  if (message.has_playing()) value.playing = message.playing();
  if (message.has_position_frames()) value.position_frames = message.position_frames();
  if (message.has_rate_hz()) value.rate_hz = message.rate_hz();
  if (message.has_loop()) value.loop = message.loop();
  if (message.has_interpolate()) value.interpolate = message.interpolate();
  return value;
}

v1::ControlSeriesRequest ToProto(const ControlSeriesRequest& value) {
  v1::ControlSeriesRequest message;
  if (value.playing) message.set_playing(*value.playing);
  if (value.position_frames) message.set_position_frames(*value.position_frames);
  if (value.rate_hz) message.set_rate_hz(*value.rate_hz);
  if (value.loop) message.set_loop(*value.loop);
  if (value.interpolate) message.set_interpolate(*value.interpolate);
  return message;
}

LoadSeriesResult FromProto(const v1::LoadSeriesResult& message) {
  LoadSeriesResult value;
  if (message.has_volume()) value.volume = FromProto(message.volume());
  if (message.has_series()) value.series = FromProto(message.series());
  value.applied_tick = message.applied_tick();
  value.settings_revision = message.settings_revision();
  value.isovalue = message.isovalue();
  return value;
}

v1::LoadSeriesResult ToProto(const LoadSeriesResult& value) {
  v1::LoadSeriesResult message;
  *message.mutable_volume() = ToProto(value.volume);
  *message.mutable_series() = ToProto(value.series);
  message.set_applied_tick(value.applied_tick);
  message.set_settings_revision(value.settings_revision);
  message.set_isovalue(value.isovalue);
  return message;
}

ControlSeriesResponse FromProto(const v1::ControlSeriesResponse& message) {
  ControlSeriesResponse value;
  if (message.has_series()) value.series = FromProto(message.series());
  value.applied_tick = message.applied_tick();
  return value;
}

v1::ControlSeriesResponse ToProto(const ControlSeriesResponse& value) {
  v1::ControlSeriesResponse message;
  *message.mutable_series() = ToProto(value.series);
  message.set_applied_tick(value.applied_tick);
  return message;
}

PoseSample FromProto(const v1::PoseSample& message) {
  PoseSample value;
  value.tick = message.tick();
  value.time_ns = message.time_ns();
  if (message.has_hip_mm()) value.hip_mm = FromProto(message.hip_mm());
  if (message.has_scp_h_mm()) value.scp_h_mm = FromProto(message.scp_h_mm());
  if (message.has_scp_h_normal()) value.scp_h_normal = FromProto(message.scp_h_normal());
  if (message.has_scp_v_mm()) value.scp_v_mm = FromProto(message.scp_v_mm());
  if (message.has_scp_v_normal()) value.scp_v_normal = FromProto(message.scp_v_normal());
  if (message.has_stylus_orientation()) value.stylus_orientation = UnalignedQuaternion(FromProto(message.stylus_orientation()));
  value.buttons = message.buttons();
  if (message.has_force_n()) value.force_n = FromProto(message.force_n());
  value.mode = EnumeratorOf<ProxyMode>(message.mode());
  value.contact = message.contact();
  value.density = message.density();
  value.isovalue = message.isovalue();
  value.settings_revision = message.settings_revision();
  value.volume_revision = message.volume_revision();
  value.update_ns = message.update_ns();
  value.missed_ticks = message.missed_ticks();
  value.iterations = message.iterations();
  value.capped_ticks = message.capped_ticks();
  value.free_side = EnumeratorOf<FreeSide>(message.free_side());
  if (message.has_forces()) value.forces = FromProto(message.forces());
  value.replayed = message.replayed();
  value.refinement = message.refinement();
  value.layers_passed = message.layers_passed();
  value.contact_layer = message.contact_layer();
  value.tool_radius_mm = message.tool_radius_mm();
  value.hand = message.hand();
  if (message.has_torque_n_mm()) value.torque_n_mm = FromProto(message.torque_n_mm());
  if (message.has_tool_orientation()) value.tool_orientation = UnalignedQuaternion(FromProto(message.tool_orientation()));
  value.touching_balls = message.touching_balls();
  return value;
}

v1::PoseSample ToProto(const PoseSample& value) {
  v1::PoseSample message;
  message.set_tick(value.tick);
  message.set_time_ns(value.time_ns);
  *message.mutable_hip_mm() = ToProto(value.hip_mm);
  *message.mutable_scp_h_mm() = ToProto(value.scp_h_mm);
  if (value.scp_h_normal) *message.mutable_scp_h_normal() = ToProto(*value.scp_h_normal);
  if (value.scp_v_mm) *message.mutable_scp_v_mm() = ToProto(*value.scp_v_mm);
  if (value.scp_v_normal) *message.mutable_scp_v_normal() = ToProto(*value.scp_v_normal);
  *message.mutable_stylus_orientation() = ToProto(Eigen::Quaterniond(value.stylus_orientation));
  message.set_buttons(value.buttons);
  *message.mutable_force_n() = ToProto(value.force_n);
  message.set_mode(static_cast<v1::ProxyMode>(value.mode));
  message.set_contact(value.contact);
  message.set_density(value.density);
  message.set_isovalue(value.isovalue);
  message.set_settings_revision(value.settings_revision);
  message.set_volume_revision(value.volume_revision);
  message.set_update_ns(value.update_ns);
  message.set_missed_ticks(value.missed_ticks);
  message.set_iterations(value.iterations);
  message.set_capped_ticks(value.capped_ticks);
  message.set_free_side(static_cast<v1::FreeSide>(value.free_side));
  *message.mutable_forces() = ToProto(value.forces);
  message.set_replayed(value.replayed);
  message.set_refinement(value.refinement);
  message.set_layers_passed(value.layers_passed);
  message.set_contact_layer(value.contact_layer);
  message.set_tool_radius_mm(value.tool_radius_mm);
  message.set_hand(value.hand);
  *message.mutable_torque_n_mm() = ToProto(value.torque_n_mm);
  if (value.tool_orientation) *message.mutable_tool_orientation() = ToProto(Eigen::Quaterniond(*value.tool_orientation));
  message.set_touching_balls(value.touching_balls);
  return message;
}

RecordedTick FromProto(const v1::RecordedTick& message) {
  RecordedTick value;
  if (message.has_pose()) value.pose = FromProto(message.pose());
  value.force_command = EnumeratorOf<ForceCommand>(message.force_command());
  value.device_status = EnumeratorOf<DeviceStatus>(message.device_status());
  value.docked = message.docked();
  value.calibrated = message.calibrated();
  value.input_rejected = message.input_rejected();
  value.scene_revision = message.scene_revision();
  value.faulty_ticks = message.faulty_ticks();
  if (message.has_led_target_mm()) value.led_target_mm = FromProto(message.led_target_mm());
  if (message.has_series_position_frames()) value.series_position_frames = message.series_position_frames();
  if (message.has_push_n()) value.push_n = FromProto(message.push_n());
  return value;
}

v1::RecordedTick ToProto(const RecordedTick& value) {
  v1::RecordedTick message;
  *message.mutable_pose() = ToProto(value.pose);
  message.set_force_command(static_cast<v1::ForceCommand>(value.force_command));
  message.set_device_status(static_cast<v1::DeviceStatus>(value.device_status));
  message.set_docked(value.docked);
  message.set_calibrated(value.calibrated);
  message.set_input_rejected(value.input_rejected);
  message.set_scene_revision(value.scene_revision);
  message.set_faulty_ticks(value.faulty_ticks);
  if (value.led_target_mm) *message.mutable_led_target_mm() = ToProto(*value.led_target_mm);
  if (value.series_position_frames) message.set_series_position_frames(*value.series_position_frames);
  if (value.push_n) *message.mutable_push_n() = ToProto(*value.push_n);
  return message;
}

RecordedKeyframe FromProto(const v1::RecordedKeyframe& message) {
  RecordedKeyframe value;
  value.tick = message.tick();
  value.state = message.state();
  return value;
}

v1::RecordedKeyframe ToProto(const RecordedKeyframe& value) {
  v1::RecordedKeyframe message;
  message.set_tick(value.tick);
  message.set_state(value.state);
  return message;
}

RecordedEvent FromProto(const v1::RecordedEvent& message) {
  RecordedEvent value;
  value.tick = message.tick();
  value.time_ns = message.time_ns();
  value.marker = message.marker();
  return value;
}

v1::RecordedEvent ToProto(const RecordedEvent& value) {
  v1::RecordedEvent message;
  message.set_tick(value.tick);
  message.set_time_ns(value.time_ns);
  message.set_marker(Utf8(value.marker));
  return message;
}

RecordedClock FromProto(const v1::RecordedClock& message) {
  RecordedClock value;
  value.time_ns = message.time_ns();
  value.unix_ns = message.unix_ns();
  return value;
}

v1::RecordedClock ToProto(const RecordedClock& value) {
  v1::RecordedClock message;
  message.set_time_ns(value.time_ns);
  message.set_unix_ns(value.unix_ns);
  return message;
}

Registration FromProto(const v1::Registration& message) {
  Registration value;
  if (message.has_center_mm()) value.center_mm = FromProto(message.center_mm());
  if (message.has_rotation()) value.rotation = UnalignedQuaternion(FromProto(message.rotation()));
  value.device_mm_per_volume_mm = message.device_mm_per_volume_mm();
  value.device_mm_per_voxel = message.device_mm_per_voxel();
  return value;
}

v1::Registration ToProto(const Registration& value) {
  v1::Registration message;
  *message.mutable_center_mm() = ToProto(value.center_mm);
  *message.mutable_rotation() = ToProto(Eigen::Quaterniond(value.rotation));
  message.set_device_mm_per_volume_mm(value.device_mm_per_volume_mm);
  message.set_device_mm_per_voxel(value.device_mm_per_voxel);
  return message;
}

PatientFacing FromProto(const v1::PatientFacing& message) {
  PatientFacing value;
  value.face = message.face();
  value.head = message.head();
  if (message.has_loaded_revision()) value.loaded_revision = message.loaded_revision();
  return value;
}

v1::PatientFacing ToProto(const PatientFacing& value) {
  v1::PatientFacing message;
  message.set_face(Utf8(value.face));
  message.set_head(Utf8(value.head));
  if (value.loaded_revision) message.set_loaded_revision(*value.loaded_revision);
  return message;
}

GetRegistrationResponse FromProto(const v1::GetRegistrationResponse& message) {
  GetRegistrationResponse value;
  if (message.has_registration()) value.registration = FromProto(message.registration());
  value.settings_revision = message.settings_revision();
  value.replayed = message.replayed();
  return value;
}

v1::GetRegistrationResponse ToProto(const GetRegistrationResponse& value) {
  v1::GetRegistrationResponse message;
  *message.mutable_registration() = ToProto(value.registration);
  message.set_settings_revision(value.settings_revision);
  message.set_replayed(value.replayed);
  return message;
}

UpdateRegistrationRequest FromProto(const v1::UpdateRegistrationRequest& message) {
  UpdateRegistrationRequest value;
  value.reset = message.reset();
  if (message.has_center_mm()) value.center_mm = FromProto(message.center_mm());
  if (message.has_rotation()) value.rotation = UnalignedQuaternion(FromProto(message.rotation()));
  if (message.has_device_mm_per_volume_mm()) value.device_mm_per_volume_mm = message.device_mm_per_volume_mm();
  if (message.has_device_mm_per_voxel()) value.device_mm_per_voxel = message.device_mm_per_voxel();
  if (message.has_translate_mm()) value.translate_mm = FromProto(message.translate_mm());
  if (message.has_rotate()) value.rotate = UnalignedQuaternion(FromProto(message.rotate()));
  if (message.has_scale_by()) value.scale_by = message.scale_by();
  if (message.has_expected_revision()) value.expected_revision = message.expected_revision();
  if (message.has_facing()) value.facing = FromProto(message.facing());
  return value;
}

v1::UpdateRegistrationRequest ToProto(const UpdateRegistrationRequest& value) {
  v1::UpdateRegistrationRequest message;
  message.set_reset(value.reset);
  if (value.center_mm) *message.mutable_center_mm() = ToProto(*value.center_mm);
  if (value.rotation) *message.mutable_rotation() = ToProto(Eigen::Quaterniond(*value.rotation));
  if (value.device_mm_per_volume_mm) message.set_device_mm_per_volume_mm(*value.device_mm_per_volume_mm);
  if (value.device_mm_per_voxel) message.set_device_mm_per_voxel(*value.device_mm_per_voxel);
  if (value.translate_mm) *message.mutable_translate_mm() = ToProto(*value.translate_mm);
  if (value.rotate) *message.mutable_rotate() = ToProto(Eigen::Quaterniond(*value.rotate));
  if (value.scale_by) message.set_scale_by(*value.scale_by);
  if (value.expected_revision) message.set_expected_revision(*value.expected_revision);
  if (value.facing) *message.mutable_facing() = ToProto(*value.facing);
  return message;
}

UpdateRegistrationResponse FromProto(const v1::UpdateRegistrationResponse& message) {
  UpdateRegistrationResponse value;
  if (message.has_registration()) value.registration = FromProto(message.registration());
  value.settings_revision = message.settings_revision();
  value.applied_tick = message.applied_tick();
  value.not_kept = message.not_kept();
  return value;
}

v1::UpdateRegistrationResponse ToProto(const UpdateRegistrationResponse& value) {
  v1::UpdateRegistrationResponse message;
  *message.mutable_registration() = ToProto(value.registration);
  message.set_settings_revision(value.settings_revision);
  message.set_applied_tick(value.applied_tick);
  message.set_not_kept(Utf8(value.not_kept));
  return message;
}

}  // namespace palpate
