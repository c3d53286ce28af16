// Written by proto/generate from palpate/v1/render.proto: change that.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/geometry/geometry.h"

namespace palpate {

// One of several isosurfaces that are felt one behind the other, such as skin over bone. Units
// and ranges are those of the settings with the same names.
struct SurfaceLayer {
  // 1 to 8: names the layer while its isovalue changes. A layer that the stylus has passed
  // stays passed while its id stays. 0 in an update: the id of the layer with this name, or one
  // that no layer has.
  std::uint32_t id = 0;
  // For people: "skin". 1 to 31 bytes, different for each layer.
  std::string name{};
  // In data units, within the volume's range.
  double isovalue = 0.0;
  double stiffness_n_per_mm = 0.0;
  double damping_n_s_per_m = 0.0;
  double static_friction = 0.0;
  double dynamic_friction = 0.0;
  // Spring force at which the stylus passes through the layer inwards; 0: never.
  double pop_force_n = 0.0;
  // The same outwards; absent: pop_force_n.
  std::optional<double> pop_out_force_n{};
  // Drag on the stylus while this is the last layer that it has passed.
  double viscosity_n_s_per_m = 0.0;
  friend bool operator==(const SurfaceLayer&, const SurfaceLayer&) = default;
};
template <class Visit>
void VisitFields(const SurfaceLayer& value, Visit&& visit) {
  visit("id", value.id);
  visit("name", value.name);
  visit("isovalue", value.isovalue);
  visit("stiffness_n_per_mm", value.stiffness_n_per_mm);
  visit("damping_n_s_per_m", value.damping_n_s_per_m);
  visit("static_friction", value.static_friction);
  visit("dynamic_friction", value.dynamic_friction);
  visit("pop_force_n", value.pop_force_n);
  visit("pop_out_force_n", value.pop_out_force_n);
  visit("viscosity_n_s_per_m", value.viscosity_n_s_per_m);
}
template <class Visit>
void VisitFields(SurfaceLayer& value, Visit&& visit) {
  visit("id", value.id);
  visit("name", value.name);
  visit("isovalue", value.isovalue);
  visit("stiffness_n_per_mm", value.stiffness_n_per_mm);
  visit("damping_n_s_per_m", value.damping_n_s_per_m);
  visit("static_friction", value.static_friction);
  visit("dynamic_friction", value.dynamic_friction);
  visit("pop_force_n", value.pop_force_n);
  visit("pop_out_force_n", value.pop_out_force_n);
  visit("viscosity_n_s_per_m", value.viscosity_n_s_per_m);
}

// A ball of a rigid tool.
struct HeldToolBall {
  // In the stylus's axes, from the stylus's tip (hip_mm); the stylus points along its -z. On
  // the device, in mm.
  Vec3 center_mm = Vec3::Zero();
  // On the device. 0: a point; else 0.3 to 8 voxels of the shortest edge. A tool has at most 3
  // different radii.
  double radius_mm = 0.0;
  // It carves while carve_tool's button is held.
  bool carves = false;
  friend bool operator==(const HeldToolBall&, const HeldToolBall&) = default;
};
template <class Visit>
void VisitFields(const HeldToolBall& value, Visit&& visit) {
  visit("center_mm", value.center_mm);
  visit("radius_mm", value.radius_mm);
  visit("carves", value.carves);
}
template <class Visit>
void VisitFields(HeldToolBall& value, Visit&& visit) {
  visit("center_mm", value.center_mm);
  visit("radius_mm", value.radius_mm);
  visit("carves", value.carves);
}

// What is felt of the settings' ball or tool.
struct BallState {
  // Of the ball that is felt, on the device; 0: a point, or a tool.
  double felt_radius_mm = 0.0;
  // The settings ask for another ball or tool, or for the other side, and its field is being
  // made.
  bool is_awaited = false;
  // The share that is done of the field in the making, 0 to 1; absent: none is made.
  std::optional<double> share_done{};
  // Why the ball or tool of the settings is not felt; empty: it is, or is being made.
  std::string problem{};
  friend bool operator==(const BallState&, const BallState&) = default;
};
template <class Visit>
void VisitFields(const BallState& value, Visit&& visit) {
  visit("felt_radius_mm", value.felt_radius_mm);
  visit("is_awaited", value.is_awaited);
  visit("share_done", value.share_done);
  visit("problem", value.problem);
}
template <class Visit>
void VisitFields(BallState& value, Visit&& visit) {
  visit("felt_radius_mm", value.felt_radius_mm);
  visit("is_awaited", value.is_awaited);
  visit("share_done", value.share_done);
  visit("problem", value.problem);
}

struct SurfaceLayers {
  // At most 8, their isovalues at least a millionth of the volume's range apart. Answers have
  // them by ascending isovalue, as a stylus meets them from outside.
  std::vector<SurfaceLayer> layer{};
  friend bool operator==(const SurfaceLayers&, const SurfaceLayers&) = default;
};
template <class Visit>
void VisitFields(const SurfaceLayers& value, Visit&& visit) {
  visit("layer", value.layer);
}
template <class Visit>
void VisitFields(SurfaceLayers& value, Visit&& visit) {
  visit("layer", value.layer);
}

// A rigid tool in the hand, such as a drill with its shaft: it is felt with all of its balls,
// by force and torque.
struct HeldTool {
  // For people: "drill". At most 31 bytes.
  std::string name{};
  // At most 64, within 500 mm of the tip; none: the stylus's tip is felt alone.
  std::vector<HeldToolBall> ball{};
  // A turn by an angle counts as a way of this length times the angle: the torque that turns
  // the tool back is the stiffness times its square. 1 to 300 mm; 0: 30 mm.
  double rotation_length_mm = 0.0;
  friend bool operator==(const HeldTool&, const HeldTool&) = default;
};
template <class Visit>
void VisitFields(const HeldTool& value, Visit&& visit) {
  visit("name", value.name);
  visit("ball", value.ball);
  visit("rotation_length_mm", value.rotation_length_mm);
}
template <class Visit>
void VisitFields(HeldTool& value, Visit&& visit) {
  visit("name", value.name);
  visit("ball", value.ball);
  visit("rotation_length_mm", value.rotation_length_mm);
}

}  // namespace palpate
