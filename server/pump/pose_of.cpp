#include "server/pump/pose_of.h"

#include <limits>

#include "common/geometry/sphere_directions.h"
#include "server/haptics/visual_proxy.h"

namespace palpate {
namespace {

constexpr int kDirections = 200;
constexpr double kFirstStep = 0.15;  // rad; about the distance of two directions
constexpr double kLastStep = 1e-3;
constexpr int kMostSteps = 40;
// How far V can be beyond the sphere, in longest voxel edges.
constexpr double kBeyondVoxels = 1.5;
constexpr int kOtherWays = 64;

class OnSphere {
 public:
  OnSphere(const HapticSurface& surface, const Vec3& center_D_mm, double radius_mm)
      : surface_(surface),
        center_I_(surface.X_ID.Apply(center_D_mm)),
        radius_I_(radius_mm * surface.X_ID.linear) {}

  double Density(const Vec3& direction_D) {
    At(direction_D);
    return f_.Value(local_);
  }
  // Of the density with the direction.
  Vec3 Gradient(const Vec3& direction_D) {
    At(direction_D);
    return radius_I_.transpose() * f_.Gradient(local_);
  }

 private:
  void At(const Vec3& direction_D) {
    const Vec3 p_I = center_I_ + radius_I_ * direction_D;
    const Vec3i cell = p_I.array().floor().cast<int>();
    if (cell != cell_) f_ = Trilinear(surface_.Felt(surface_.volume->StoredCell(cell)));
    cell_ = cell;
    local_ = p_I - cell.cast<double>();
  }

  const HapticSurface& surface_;
  const Vec3 center_I_;
  const Mat3 radius_I_;
  Vec3i cell_ = Vec3i::Constant(std::numeric_limits<int>::min());
  Trilinear f_{CellDensities{}};
  Vec3 local_;
};

Vec3 Highest(OnSphere& sphere) {
  Vec3 highest = Vec3::UnitZ();
  double most = -std::numeric_limits<double>::infinity();
  VisitDirections(kDirections, [&](const Vec3& direction) {
    const double density = sphere.Density(direction);
    if (density > most) most = density, highest = direction;
  });
  // Up the slope, by shorter steps where one does not lead up.
  double step = kFirstStep;
  for (int n = 0; n < kMostSteps && step > kLastStep; ++n) {
    Vec3 up = sphere.Gradient(highest);
    up -= up.dot(highest) * highest;
    if (!(up.norm() > 0.0)) break;
    const Vec3 next = (highest + step * up.normalized()).normalized();
    const double density = sphere.Density(next);
    if (density > most) {
      most = density, highest = next;
    } else {
      step *= 0.5;
    }
  }
  return highest;
}

}  // namespace

VisualProxy FindTouchedPoint(const HapticSurface& surface, const Vec3& center_D_mm,
                             double radius_mm) noexcept {
  OnSphere sphere(surface, center_D_mm, radius_mm);
  const double reach_mm = radius_mm + kBeyondVoxels * surface.longest_voxel_mm;
  const VisualProxy touched = FirstOnWay(surface, center_D_mm, Highest(sphere), reach_mm);
  if (touched.found) return touched;
  // Where values jump from one voxel to the next, V is not on that way.
  VisualProxy nearest;
  double nearest_mm = reach_mm;
  VisitDirections(kOtherWays, [&](const Vec3& direction) {
    const VisualProxy other = FirstOnWay(surface, center_D_mm, direction, nearest_mm);
    if (!other.found) return;
    nearest = other;
    nearest_mm = (other.p_DV_mm - center_D_mm).norm();
  });
  return nearest;
}

namespace {

VisualProxy OfPoint(const Scene& scene, bool is_flipped, CellCache& cache,
                    const TickSample& sample) noexcept {
  const SurfacePlace& at = sample.surface_place;
  HapticSurface surface = is_flipped ? scene.surface.Flipped() : scene.surface;
  surface.isovalue = at.isovalue;
  surface.Refine(static_cast<int>(sample.refinement));
  Place place;
  place.kind = Place::Kind::kSimplex;
  place.cell = Vec3i(at.cell.data());
  place.carrier = {at.vertex_count, at.vertex, at.weight};
  place.faces = FacesOf(place.carrier);
  return FindVisualProxy(surface, place, Vec3(sample.scp_h_normal.data()), cache);
}

// The ball's centre is on a surface of the field; what it touches is in the volume.
VisualProxy OfBall(const Scene& scene, bool is_flipped, const TickSample& sample) noexcept {
  const double isovalue =
      is_flipped ? -sample.surface_place.isovalue : sample.surface_place.isovalue;
  HapticSurface surface =
      MakeHapticSurface(*scene.volume, scene.X_DI(), 0.0, scene.surface.method,
                        scene.surface.geometry_revision, scene.surface.free_side);
  surface.isovalue = isovalue;
  VisualProxy touched =
      FindTouchedPoint(surface, Vec3(sample.scp_h_mm.data()), scene.ball->radius_mm);
  if (is_flipped) touched.normal_D = -touched.normal_D;
  return touched;
}

}  // namespace

void AddScpV(const Scene& scene, CellCache& cache, TickSample& sample) noexcept {
  if (sample.surface_place.vertex_count == 0) return;
  const bool is_flipped = sample.free_side != scene.surface.free_side;
  const VisualProxy visual =
      scene.ball ? OfBall(scene, is_flipped, sample) : OfPoint(scene, is_flipped, cache, sample);
  sample.has_scp_v = visual.found;
  for (int axis = 0; axis < 3; ++axis) {
    sample.scp_v_mm[axis] = visual.p_DV_mm[axis];
    sample.scp_v_normal[axis] = visual.normal_D[axis];
  }
}

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
