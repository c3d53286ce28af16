#include "server/recording/recorded_tick.h"

#include <algorithm>
#include <array>

#include "server/pump/pose_of.h"
#include "server/recording/bytes.h"

namespace palpate {
namespace {

std::array<double, 3> ArrayOf(const Vec3& v) { return {v.x(), v.y(), v.z()}; }

}  // namespace

RecordedTick RecordedTickOf(const TickSample& sample) {
  RecordedTick tick{.pose = PoseOf(sample),
                    .force_command = sample.force_command,
                    .device_status = sample.device_status,
                    .docked = sample.docked,
                    .calibrated = sample.calibrated,
                    .input_rejected = sample.input_rejected,
                    .scene_revision = sample.scene_revision,
                    .faulty_ticks = sample.faulty_ticks};
  if (sample.is_led()) tick.led_target_mm = Vec3(sample.led_target_mm.data());
  if (sample.is_pushed()) tick.push_n = Vec3(sample.push_n.data());
  if (sample.shows_series()) tick.series_position_frames = sample.series_position_frames;
  return tick;
}

TickSample SampleOf(const RecordedTick& tick) {
  const PoseSample& pose = tick.pose;
  const auto& q = pose.stylus_orientation;
  const Vec3 kNone = Vec3::Constant(TickSample::kNone);
  const UnalignedQuaternion no_tool(TickSample::kNone, TickSample::kNone, TickSample::kNone,
                                    TickSample::kNone);
  const UnalignedQuaternion tool = pose.tool_orientation.value_or(no_tool);
  const TickSample sample{
      .tick = pose.tick,
      .time_ns = pose.time_ns,
      .hip_mm = ArrayOf(pose.hip_mm),
      .scp_h_mm = ArrayOf(pose.scp_h_mm),
      .scp_h_normal = ArrayOf(pose.scp_h_normal.value_or(Vec3::Zero())),
      .scp_v_mm = ArrayOf(pose.scp_v_mm.value_or(Vec3::Zero())),
      .scp_v_normal = ArrayOf(pose.scp_v_normal.value_or(Vec3::Zero())),
      .stylus_orientation = {q.w(), q.x(), q.y(), q.z()},
      .force_n = ArrayOf(pose.force_n),
      .torque_n_mm = ArrayOf(pose.torque_n_mm),
      .led_target_mm = ArrayOf(tick.led_target_mm.value_or(kNone)),
      .push_n = ArrayOf(tick.push_n.value_or(kNone)),
      .tool_orientation = {tool.w(), tool.x(), tool.y(), tool.z()},
      .density = pose.density,
      .isovalue = pose.isovalue,
      .force_limit_n = pose.forces.limit_n,
      .torque_limit_n_mm = pose.forces.torque_limit_n_mm,
      .series_position_frames = tick.series_position_frames.value_or(TickSample::kNone),
      .tool_radius_mm = pose.tool_radius_mm,
      .touching_balls = pose.touching_balls,
      .scene_revision = tick.scene_revision,
      .settings_revision = pose.settings_revision,
      .volume_revision = pose.volume_revision,
      .update_ns = pose.update_ns,
      .missed_ticks = pose.missed_ticks,
      .capped_ticks = pose.capped_ticks,
      .faulty_ticks = tick.faulty_ticks,
      .buttons = pose.buttons,
      .iterations = pose.iterations,
      .refinement = std::max(pose.refinement, 1u),  // recordings before it have none
      .layers_passed = pose.layers_passed,
      .contact_layer = pose.contact_layer,
      .mode = pose.mode,
      .free_side = pose.free_side,
      .contact = pose.contact,
      .has_scp_v = pose.scp_v_mm.has_value(),
      .input_rejected = tick.input_rejected,
      .force_state = pose.forces.state,
      .force_reason = pose.forces.reason,
      .force_command = tick.force_command,
      .device_status = tick.device_status,
      .docked = tick.docked,
      .calibrated = tick.calibrated,
  };
  if (pose.hand != 0) {
    throw DamagedBytes(kSeveralHands);
  }
  if (sample.mode == ProxyMode::kUnknown || sample.free_side == FreeSide::kUnknown ||
      sample.force_state == ForceState::kUnknown || sample.force_reason == ForceReason::kUnknown ||
      sample.force_command == ForceCommand::kUnknown ||
      sample.device_status == DeviceStatus::kUnknown) {
    throw DamagedBytes("damaged: a tick has a word that this program does not know");
  }
  return sample;
}

}  // namespace palpate
