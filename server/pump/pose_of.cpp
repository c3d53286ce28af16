#include "server/pump/pose_of.h"

namespace palpate {
namespace {

Vec3 VectorOf(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }

}  // namespace

PoseSample PoseOf(const TickSample& sample) {
  PoseSample pose;
  pose.tick = sample.tick;
  pose.time_ns = sample.time_ns;
  pose.hip_mm = VectorOf(sample.hip_mm);
  pose.scp_h_mm = VectorOf(sample.scp_h_mm);
  if (sample.contact) pose.scp_h_normal = VectorOf(sample.scp_h_normal);
  if (sample.has_scp_v) {
    pose.scp_v_mm = VectorOf(sample.scp_v_mm);
    pose.scp_v_normal = VectorOf(sample.scp_v_normal);
  }
  const auto& [w, x, y, z] = sample.stylus_orientation;
  pose.stylus_orientation = {w, x, y, z};
  pose.buttons = sample.buttons;
  pose.force_n = VectorOf(sample.force_n);
  pose.mode = sample.mode;
  pose.contact = sample.contact;
  pose.density = sample.density;
  pose.isovalue = sample.isovalue;
  pose.settings_revision = sample.settings_revision;
  pose.volume_revision = sample.volume_revision;
  pose.update_ns = sample.update_ns;
  pose.missed_ticks = sample.missed_ticks;
  pose.iterations = sample.iterations;
  pose.capped_ticks = sample.capped_ticks;
  pose.free_side = sample.free_side;
  pose.forces = ForcesOf(
      {sample.force_state, sample.force_reason, sample.force_limit_n, sample.torque_limit_n_mm},
      sample.replayed);
  pose.replayed = sample.replayed;
  pose.refinement = sample.refinement;
  pose.layers_passed = sample.layers_passed;
  pose.contact_layer = sample.contact_layer;
  pose.tool_radius_mm = sample.tool_radius_mm;
  pose.hand = sample.hand;
  pose.torque_n_mm = VectorOf(sample.torque_n_mm);
  if (sample.has_tool()) {
    const auto& [tool_w, tool_x, tool_y, tool_z] = sample.tool_orientation;
    pose.tool_orientation = {tool_w, tool_x, tool_y, tool_z};
  }
  pose.touching_balls = sample.touching_balls;
  return pose;
}

ForceStatus ForcesOf(ForceStatus forces, bool replay) {
  // For the safety stage, a replay is no state: it gets zero forces to write.
  if (replay && (forces.state == ForceState::kOn || forces.state == ForceState::kRampIn)) {
    forces.state = ForceState::kHeld;
    forces.reason = ForceReason::kReplay;
  }
  return forces;
}

}  // namespace palpate
