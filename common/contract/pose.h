// Written by proto/generate from palpate/v1/pose.proto: change that.
#pragma once

#include <cstdint>
#include <optional>

#include "common/contract/device.h"
#include "common/contract/enumerations.h"
#include "common/geometry/geometry.h"

namespace palpate {

// One tick of the servo thread. During a replay: a recorded tick in place of the live one.
struct PoseSample {
  // Ticks executed before this one since the daemon started. Not a time: ticks can be missed
  // (missed_ticks), and a new daemon counts from 0 again.
  std::uint64_t tick = 0;
  // CLOCK_MONOTONIC of the host at the start of the tick.
  std::int64_t time_ns = 0;
  // Haptic interface point: the stylus tip as the device reports it.
  Vec3 hip_mm = Vec3::Zero();
  // SCP_H, the proxy: on the haptic isosurface H, or on its free side. With a tool: its origin.
  Vec3 scp_h_mm = Vec3::Zero();
  // Unit normal of H at SCP_H, towards free space; absent without contact. With a tool: the
  // direction in which the surface pushes it; zero where it only turns it.
  std::optional<Vec3> scp_h_normal{};
  // SCP_V, the visual proxy on the trilinear isosurface V. Absent without contact, and if the
  // line from SCP_H does not meet V within reach.
  std::optional<Vec3> scp_v_mm{};
  // Unit normal of V at SCP_V, towards free space; absent without scp_v_mm.
  std::optional<Vec3> scp_v_normal{};
  // Rotates stylus axes into the device frame; the stylus points along its -z.
  UnalignedQuaternion stylus_orientation = UnalignedQuaternion::Identity();
  // Bit n: button n is pressed.
  std::uint32_t buttons = 0;
  // Force on the hand, after every limit, in N.
  Vec3 force_n = Vec3::Zero();
  ProxyMode mode = ProxyMode::kUnknown;
  // SCP_H rests on H.
  bool contact = false;
  // Piecewise-linear density at SCP_H, in data units; with a ball, of the field that the ball
  // feels, not of the volume; with a rigid tool, of its first ball's field at that ball's
  // centre. It lies on the side of `isovalue` given by free_side, except while ejecting,
  // suspended, inside or in a fault.
  double density = 0.0;
  // Isovalue used in this tick, in data units; with layers, that of the layer in contact, else
  // of the next one inwards, else of the last one. While the stylus touches, it moves to the
  // isovalue of the settings at a bounded rate, unless the volume, its place, the side or the
  // method are new.
  double isovalue = 0.0;
  // Revision of the settings used in this tick.
  std::uint64_t settings_revision = 0;
  // Revision of the volume used in this tick.
  std::uint64_t volume_revision = 0;
  // Duration of the haptic update, without device I/O and sleep.
  std::int64_t update_ns = 0;
  // Ticks skipped since the start because their time had passed. tick + missed_ticks counts
  // milliseconds.
  std::uint64_t missed_ticks = 0;
  // Proxy moves made in this tick; with a tool, its rounds.
  std::uint32_t iterations = 0;
  // Total of ticks in which the proxy reached the limit of its moves.
  std::uint64_t capped_ticks = 0;
  // Side of the isovalue's surface on which the proxy is. After a pop, the opposite of the
  // settings' side; with layers, "above" also means that the stylus touches a layer from
  // within.
  FreeSide free_side = FreeSide::kUnknown;
  // What the safety stage did in this tick.
  ForceStatus forces{};
  // A recording is replayed: the sample is a recorded one. Only tick, time_ns, missed_ticks,
  // capped_ticks and the state of the forces are those of the live tick, whose force is zero.
  // The revisions are those of the recorded settings and volume that viewers are shown
  // (FactsService).
  bool replayed = false;
  // Refinement of H in this tick. Another one of the settings takes effect once the stylus
  // touches nothing. 0: a program that does not know it, which has 1.
  std::uint32_t refinement = 0;
  // Layers of the settings that the stylus has passed, from outside inwards; 0 without layers.
  std::uint32_t layers_passed = 0;
  // Id of the layer that SCP_H rests on; 0: none, or the settings have no layers.
  std::uint32_t contact_layer = 0;
  // Radius of the ball that is felt in this tick, on the device; 0: a point. SCP_H is its
  // centre, SCP_V where it touches V.
  double tool_radius_mm = 0.0;
  // Which hand; 0 so far.
  std::uint32_t hand = 0;
  // Torque on the hand, after every limit, about hip_mm, in N mm.
  Vec3 torque_n_mm = Vec3::Zero();
  // Of the tool that is felt: turns its axes into the device frame. scp_h_mm is its origin,
  // where a free tool has the stylus's tip. Absent: no tool is felt.
  std::optional<UnalignedQuaternion> tool_orientation{};
  // Bit n: the tool is held back by its ball n.
  std::uint64_t touching_balls = 0;
  friend bool operator==(const PoseSample&, const PoseSample&) = default;
};
template <class Visit>
void VisitFields(const PoseSample& value, Visit&& visit) {
  visit("tick", value.tick);
  visit("time_ns", value.time_ns);
  visit("hip_mm", value.hip_mm);
  visit("scp_h_mm", value.scp_h_mm);
  visit("scp_h_normal", value.scp_h_normal);
  visit("scp_v_mm", value.scp_v_mm);
  visit("scp_v_normal", value.scp_v_normal);
  visit("stylus_orientation", value.stylus_orientation);
  visit("buttons", value.buttons);
  visit("force_n", value.force_n);
  visit("mode", value.mode);
  visit("contact", value.contact);
  visit("density", value.density);
  visit("isovalue", value.isovalue);
  visit("settings_revision", value.settings_revision);
  visit("volume_revision", value.volume_revision);
  visit("update_ns", value.update_ns);
  visit("missed_ticks", value.missed_ticks);
  visit("iterations", value.iterations);
  visit("capped_ticks", value.capped_ticks);
  visit("free_side", value.free_side);
  visit("forces", value.forces);
  visit("replayed", value.replayed);
  visit("refinement", value.refinement);
  visit("layers_passed", value.layers_passed);
  visit("contact_layer", value.contact_layer);
  visit("tool_radius_mm", value.tool_radius_mm);
  visit("hand", value.hand);
  visit("torque_n_mm", value.torque_n_mm);
  visit("tool_orientation", value.tool_orientation);
  visit("touching_balls", value.touching_balls);
}
template <class Visit>
void VisitFields(PoseSample& value, Visit&& visit) {
  visit("tick", value.tick);
  visit("time_ns", value.time_ns);
  visit("hip_mm", value.hip_mm);
  visit("scp_h_mm", value.scp_h_mm);
  visit("scp_h_normal", value.scp_h_normal);
  visit("scp_v_mm", value.scp_v_mm);
  visit("scp_v_normal", value.scp_v_normal);
  visit("stylus_orientation", value.stylus_orientation);
  visit("buttons", value.buttons);
  visit("force_n", value.force_n);
  visit("mode", value.mode);
  visit("contact", value.contact);
  visit("density", value.density);
  visit("isovalue", value.isovalue);
  visit("settings_revision", value.settings_revision);
  visit("volume_revision", value.volume_revision);
  visit("update_ns", value.update_ns);
  visit("missed_ticks", value.missed_ticks);
  visit("iterations", value.iterations);
  visit("capped_ticks", value.capped_ticks);
  visit("free_side", value.free_side);
  visit("forces", value.forces);
  visit("replayed", value.replayed);
  visit("refinement", value.refinement);
  visit("layers_passed", value.layers_passed);
  visit("contact_layer", value.contact_layer);
  visit("tool_radius_mm", value.tool_radius_mm);
  visit("hand", value.hand);
  visit("torque_n_mm", value.torque_n_mm);
  visit("tool_orientation", value.tool_orientation);
  visit("touching_balls", value.touching_balls);
}

}  // namespace palpate
