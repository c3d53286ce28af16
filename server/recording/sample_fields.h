// One list of the fields of a TickSample, for recordings and for tables.
//
// Threads: pure.
#pragma once

#include "server/pump/tick_sample.h"

namespace palpate {

// Calls visit(name, field) for every field. The names include the units.
// Sample: TickSample or const TickSample.
template <class Sample, class Visit>
constexpr void VisitFields(Sample& sample, Visit&& visit) {
  const auto vector = [&](auto& v, std::string_view x, std::string_view y, std::string_view z) {
    visit(x, v[0]);
    visit(y, v[1]);
    visit(z, v[2]);
  };
  visit("tick", sample.tick);
  visit("time_ns", sample.time_ns);
  visit("mode", sample.mode);
  visit("contact", sample.contact);
  visit("free_side", sample.free_side);
  visit("input_rejected", sample.input_rejected);
  vector(sample.hip_mm, "hip_x_mm", "hip_y_mm", "hip_z_mm");
  vector(sample.scp_h_mm, "scp_h_x_mm", "scp_h_y_mm", "scp_h_z_mm");
  vector(sample.scp_h_normal, "scp_h_normal_x", "scp_h_normal_y", "scp_h_normal_z");
  visit("has_scp_v", sample.has_scp_v);
  vector(sample.scp_v_mm, "scp_v_x_mm", "scp_v_y_mm", "scp_v_z_mm");
  vector(sample.scp_v_normal, "scp_v_normal_x", "scp_v_normal_y", "scp_v_normal_z");
  vector(sample.force_n, "force_x_n", "force_y_n", "force_z_n");
  visit("stylus_w", sample.stylus_orientation[0]);
  visit("stylus_x", sample.stylus_orientation[1]);
  visit("stylus_y", sample.stylus_orientation[2]);
  visit("stylus_z", sample.stylus_orientation[3]);
  visit("buttons", sample.buttons);
  visit("density", sample.density);
  visit("isovalue", sample.isovalue);
  visit("scene_revision", sample.scene_revision);
  visit("settings_revision", sample.settings_revision);
  visit("volume_revision", sample.volume_revision);
  visit("update_ns", sample.update_ns);
  visit("iterations", sample.iterations);
  visit("refinement", sample.refinement);
  visit("layers_passed", sample.layers_passed);
  visit("contact_layer", sample.contact_layer);
  visit("tool_radius_mm", sample.tool_radius_mm);
  visit("missed_ticks", sample.missed_ticks);
  visit("capped_ticks", sample.capped_ticks);
  visit("faulty_ticks", sample.faulty_ticks);
  visit("force_state", sample.force_state);
  visit("force_reason", sample.force_reason);
  visit("force_command", sample.force_command);
  visit("force_limit_n", sample.force_limit_n);
  visit("device_status", sample.device_status);
  visit("docked", sample.docked);
  visit("calibrated", sample.calibrated);
  vector(sample.led_target_mm, "led_target_x_mm", "led_target_y_mm", "led_target_z_mm");
  visit("series_position_frames", sample.series_position_frames);
  vector(sample.push_n, "push_x_n", "push_y_n", "push_z_n");
  visit("hand", sample.hand);
  vector(sample.torque_n_mm, "torque_x_n_mm", "torque_y_n_mm", "torque_z_n_mm");
  visit("force_torque_limit_n_mm", sample.torque_limit_n_mm);
  visit("tool_w", sample.tool_orientation[0]);
  visit("tool_x", sample.tool_orientation[1]);
  visit("tool_y", sample.tool_orientation[2]);
  visit("tool_z", sample.tool_orientation[3]);
  visit("touching_balls", sample.touching_balls);
}

// The list covers the whole sample except for `surface_place`, `replayed` and the padding at its
// end.
static_assert([] {
  TickSample sample;
  std::size_t bytes = sizeof sample.surface_place + sizeof sample.replayed;
  VisitFields(sample, [&](std::string_view, auto& field) { bytes += sizeof field; });
  constexpr std::size_t kAlign = alignof(TickSample);
  return (bytes + kAlign - 1) / kAlign * kAlign == sizeof(TickSample);
}());

}  // namespace palpate
