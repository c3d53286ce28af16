// Written by proto/generate from palpate/v1/recorded.proto: change that.
//
// Every scalar is written, also 0, and varints have a constant width, so that most ticks of a
// recording have their numbers at the same places: readers view them as arrays.
#pragma once

#include "common/contract/recorded.h"
#include "server/recording/constant_layout.h"

namespace palpate {

inline void Put(const ForceStatus& value, ConstantLayout& layout) {
  layout.Varint(1, value.state, 1);
  layout.Varint(2, value.reason, 1);
  layout.Double(3, value.limit_n);
  layout.Double(4, value.torque_limit_n_mm);
}

inline void Put(const PoseSample& value, ConstantLayout& layout) {
  layout.Varint(1, value.tick, 6);
  layout.Varint(2, value.time_ns, 9);
  layout.Message(3, [&] { Put(value.hip_mm, layout); });
  layout.Message(4, [&] { Put(value.scp_h_mm, layout); });
  if (value.scp_h_normal) layout.Message(5, [&] { Put(*value.scp_h_normal, layout); });
  if (value.scp_v_mm) layout.Message(6, [&] { Put(*value.scp_v_mm, layout); });
  if (value.scp_v_normal) layout.Message(7, [&] { Put(*value.scp_v_normal, layout); });
  layout.Message(8, [&] { Put(value.stylus_orientation, layout); });
  layout.Varint(9, value.buttons, 5);
  layout.Message(10, [&] { Put(value.force_n, layout); });
  layout.Varint(11, value.mode, 1);
  layout.Varint(12, value.contact, 1);
  layout.Double(13, value.density);
  layout.Double(14, value.isovalue);
  layout.Varint(15, value.settings_revision, 6);
  layout.Varint(16, value.volume_revision, 6);
  layout.Varint(17, value.update_ns, 9);
  layout.Varint(18, value.missed_ticks, 6);
  layout.Varint(19, value.iterations, 5);
  layout.Varint(20, value.capped_ticks, 6);
  layout.Varint(21, value.free_side, 1);
  layout.Message(22, [&] { Put(value.forces, layout); });
  layout.Varint(23, value.replayed, 1);
  layout.Varint(24, value.refinement, 5);
  layout.Varint(25, value.layers_passed, 5);
  layout.Varint(26, value.contact_layer, 5);
  layout.Double(27, value.tool_radius_mm);
  layout.Varint(28, value.hand, 5);
  layout.Message(29, [&] { Put(value.torque_n_mm, layout); });
  if (value.tool_orientation) layout.Message(30, [&] { Put(*value.tool_orientation, layout); });
  layout.Varint(31, value.touching_balls, 6);
}

inline void Put(const RecordedTick& value, ConstantLayout& layout) {
  layout.Message(1, [&] { Put(value.pose, layout); });
  layout.Varint(2, value.force_command, 1);
  layout.Varint(3, value.device_status, 1);
  layout.Varint(4, value.docked, 1);
  layout.Varint(5, value.calibrated, 1);
  layout.Varint(6, value.input_rejected, 1);
  layout.Varint(7, value.scene_revision, 6);
  layout.Varint(8, value.faulty_ticks, 6);
  if (value.led_target_mm) layout.Message(9, [&] { Put(*value.led_target_mm, layout); });
  if (value.series_position_frames) layout.Double(10, *value.series_position_frames);
  if (value.push_n) layout.Message(11, [&] { Put(*value.push_n, layout); });
}

}  // namespace palpate
