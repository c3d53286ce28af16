#include "client/view/drawing/cut_handles.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "client/view/drawing/distances.h"
#include "client/view/drawing/shapes.h"

namespace palpate::view {
namespace {

using Eigen::Vector2d;

// Sizes at a scale of 1.
constexpr double kArrow_px = 52.0;
constexpr double kHead_px = 15.0;
constexpr double kDisc_px = 60.0;
constexpr double kReach_px = 9.0;  // from a handle to the pointer
// Shorter arrows point to the eye: a drag along them would have no length on the screen.
constexpr double kLeastHandle_px = 9.0;
constexpr int kRimParts = 64;
// Where an arrow's line ends for the eye, a drag goes on without end.
constexpr double kEndless_mm = 1e6;

constexpr Rgba8 kCropColor = {255, 190, 70, 220};
constexpr Rgba8 kHandleColor = {255, 176, 48, 255};
constexpr Rgba8 kLitColor = {255, 250, 225, 255};
constexpr std::uint8_t kCropBehind = 70;
constexpr std::uint8_t kHandleBehind = 130;

struct Arrow {
  Vec3 origin_D;
  Vec3 along_D;  // of length 1
  double scale;  // as in CutScene

  // The length at the arrow of this many pixels at a scale of 1.
  double Mm(double px, const Projection& projection) const {
    return px * scale * projection.MmPerPixel(origin_D);
  }
};

Arrow ArrowOfFace(const CutScene& scene, std::size_t face) {
  const auto axis = static_cast<int>(face / 2);
  const bool is_max = face % 2 == 1;
  const CropBox& crop = scene.cuts.crop;
  Vec3 fractions = 0.5 * (crop.min + crop.max);
  fractions[axis] = is_max ? crop.max[axis] : crop.min[axis];
  const Vec3 outwards_D = (is_max ? 1.0 : -1.0) * scene.X_DI.linear.col(axis);
  return {scene.X_DI.Apply(PointOfFractions(fractions, scene.lattice_size)),
          outwards_D.normalized(), scene.scale};
}

// The normal in D, not of length 1: so many voxels of offset per mm along it.
Vec3 CovectorInD(const CutScene& scene, const Vec3& normal_I) {
  return scene.X_DI.Inverse().linear.transpose() * normal_I;
}

Arrow ArrowOfPlane(const CutScene& scene, std::size_t number) {
  const ClipPlane& plane = scene.cuts.planes[number];
  const Vec3 covector_D = CovectorInD(scene, plane.normal_I);
  const double above_voxels = plane.normal_I.dot(scene.pivots_I[number]) - plane.offset_voxels;
  return {scene.X_DI.Apply(scene.pivots_I[number]) -
              above_voxels / covector_D.squaredNorm() * covector_D,
          covector_D.normalized(), scene.scale};
}

Arrow ArrowOf(const CutScene& scene, const CutHandle& handle) {
  return handle.kind == CutHandle::Kind::kFace ? ArrowOfFace(scene, handle.number)
                                               : ArrowOfPlane(scene, handle.number);
}

std::vector<CutHandle> HandlesOf(const CutScene& scene) {
  std::vector<CutHandle> handles;
  for (std::size_t face = 0; face < 6; ++face) handles.push_back({CutHandle::Kind::kFace, face});
  for (std::size_t n = 0; n < kClipPlanes; ++n) {
    if (!scene.cuts.planes[n].on) continue;
    handles.push_back({CutHandle::Kind::kPlane, n});
    handles.push_back({CutHandle::Kind::kRim, n});
  }
  return handles;
}

std::vector<Vec3> RimOf(const Arrow& plane, double radius_mm) {
  return PolygonAbout(plane.along_D, plane.origin_D, radius_mm, kRimParts);
}

// None: it cannot be taken from here.
std::optional<double> DistanceToArrow(const Arrow& arrow, const Projection& projection,
                                      const Vector2d& at_px) {
  const double length_mm = arrow.Mm(kArrow_px, projection);
  const auto from = projection.PixelOf(arrow.origin_D);
  const auto to = projection.PixelOf(arrow.origin_D + length_mm * arrow.along_D);
  if (!from || !to || (*to - *from).norm() < kLeastHandle_px * arrow.scale) return std::nullopt;
  return PixelsToLine(at_px, *from, *to);
}

struct RimPoint {
  double away_px = 0.0;
  Vec3 p_D = Vec3::Zero();
  Vector2d px = Vector2d::Zero();
};

std::optional<RimPoint> NearestOnRim(const Arrow& plane, const Projection& projection,
                                     const Vector2d& at_px) {
  std::optional<RimPoint> nearest;
  for (const Vec3& p_D : RimOf(plane, plane.Mm(kDisc_px, projection))) {
    const auto px = projection.PixelOf(p_D);
    if (!px) continue;
    const double away_px = (*px - at_px).norm();
    if (!nearest || away_px < nearest->away_px) nearest = RimPoint{away_px, p_D, *px};
  }
  return nearest;
}

std::optional<double> DistanceTo(const CutScene& scene, const CutHandle& handle,
                                 const Projection& projection, const Vector2d& at_px) {
  const Arrow arrow = ArrowOf(scene, handle);
  if (handle.kind != CutHandle::Kind::kRim) return DistanceToArrow(arrow, projection, at_px);
  const std::optional<RimPoint> point = NearestOnRim(arrow, projection, at_px);
  return point ? std::optional(point->away_px) : std::nullopt;
}

// The place on an arrow's line that is nearest to the pointer on the screen, in mm from its origin.
double PlaceAlong(const Arrow& arrow, const Projection& projection, const Vector2d& at_px) {
  const double step_mm = projection.MmPerPixel(arrow.origin_D);
  const auto from = projection.PixelOf(arrow.origin_D);
  const auto to = projection.PixelOf(arrow.origin_D + step_mm * arrow.along_D);
  if (!from || !to) return 0.0;
  const Vector2d way = (*to - *from).normalized();
  const Ray ray = projection.RayThrough(*from + way * way.dot(at_px - *from));
  // The ray and the line are in one plane. In the place where they meet, the line's distance from
  // the ray is 0.
  const Vec3 to_line = arrow.origin_D - ray.origin;
  const double cosine = arrow.along_D.dot(ray.direction);
  const double sine_squared = 1.0 - cosine * cosine;
  const double nearer_px_mm = projection.MmPerPixel(arrow.origin_D - step_mm * arrow.along_D);
  const double recedes = nearer_px_mm < step_mm ? 1.0 : -1.0;
  if (sine_squared < 1e-12) return recedes * kEndless_mm;
  const double place_mm =
      (cosine * to_line.dot(ray.direction) - to_line.dot(arrow.along_D)) / sine_squared;
  // Beyond the point where the line vanishes, the two meet behind the eye.
  const Vec3 met_D = to_line + place_mm * arrow.along_D;
  if (met_D.dot(ray.direction) <= 0.0) return recedes * kEndless_mm;
  return place_mm;
}

void AddArrow(const Arrow& arrow, const Rgba8& rgba, const Projection& projection,
              Overlay& overlay) {
  const double px_mm = arrow.Mm(1.0, projection);
  const Paint paint = {rgba, kHandleBehind};
  const double neck_mm = (kArrow_px - kHead_px) * px_mm;
  const Ring rings[] = {{0.0, 0.0, paint},
                        {0.0, 2.0 * px_mm, paint},
                        {neck_mm, 2.0 * px_mm, paint},
                        {neck_mm, 6.5 * px_mm, paint},
                        {kArrow_px * px_mm, 0.0, paint}};
  AddTurned(arrow.origin_D, arrow.along_D, rings, overlay.solids);
}

// A thin ring, so that it is as easy to see as an arrow.
void AddRim(const Arrow& plane, const Rgba8& rgba, const Projection& projection, Overlay& overlay) {
  const double px_mm = plane.Mm(1.0, projection);
  for (const double radius_px : {kDisc_px - 1.0, kDisc_px, kDisc_px + 1.0}) {
    AddOutline(RimOf(plane, radius_px * px_mm), rgba, kHandleBehind, overlay);
  }
}

}  // namespace

Cuts CutsOf(const SurfaceOptions& surface) {
  return {.crop = surface.crop, .planes = surface.planes};
}

void SetCuts(const Cuts& cuts, SurfaceOptions& surface) {
  surface.crop = cuts.crop;
  surface.planes = cuts.planes;
}

Vec3 PointOfFractions(const Vec3& fractions, const Vec3i& lattice_size) {
  const Vec3 cells = (lattice_size + Vec3i::Ones()).cast<double>();
  return fractions.cwiseProduct(cells) - Vec3::Ones();
}

std::array<double, 2> OffsetRange(const Vec3& normal_I, const Vec3i& lattice_size) {
  const Vec3 one = -normal_I;
  const Vec3 other = normal_I.cwiseProduct(lattice_size.cast<double>());
  return {one.cwiseMin(other).sum(), one.cwiseMax(other).sum()};
}

std::optional<CutHandle> HandleAt(const CutScene& scene, const Projection& projection,
                                  const Vector2d& at_px) {
  std::optional<CutHandle> hit;
  double nearest_px = kReach_px * scene.scale;
  for (const CutHandle& handle : HandlesOf(scene)) {
    const std::optional<double> away_px = DistanceTo(scene, handle, projection, at_px);
    if (!away_px || *away_px > nearest_px) continue;
    nearest_px = *away_px;
    hit = handle;
  }
  return hit;
}

CutDrag::CutDrag(const CutHandle& handle, const CutScene& scene, const Projection& projection,
                 const Vector2d& at_px)
    : handle_(handle), begun_(scene) {
  const Arrow arrow = ArrowOf(scene, handle);
  origin_D_ = arrow.origin_D;
  along_D_ = arrow.along_D;
  if (handle.kind != CutHandle::Kind::kRim) {
    taken_mm_ = PlaceAlong(arrow, projection, at_px);
    return;
  }
  radius_mm_ = arrow.Mm(kDisc_px, projection);
  const std::optional<RimPoint> point = NearestOnRim(arrow, projection, at_px);
  const Vec3 rim_D = point ? point->p_D : RimOf(arrow, radius_mm_)[0];
  is_near_ = (rim_D - origin_D_).dot(projection.eye_D() - origin_D_) >= radius_mm_ * radius_mm_;
  // The pointer may be pixels beside the rim. It stays as many pixels beside it, so nothing turns
  // before the pointer moves, and the rim does not run away from it.
  beside_px_ = point ? Vector2d(at_px - point->px) : Vector2d(Vector2d::Zero());
  taken_D_ = DirectionAt(projection, at_px - beside_px_);
}

// Where the pointer's ray meets the sphere; beside the sphere, the nearest point of its outline.
Vec3 CutDrag::DirectionAt(const Projection& projection, const Vector2d& at_px) const {
  const Ray ray = projection.RayThrough(at_px);
  const Vec3 from_center = ray.origin - origin_D_;
  const double along = -from_center.dot(ray.direction);
  const Vec3 nearest = from_center + along * ray.direction;
  const double inside = radius_mm_ * radius_mm_ - nearest.squaredNorm();
  if (inside <= 0.0) return nearest.normalized();
  const double half = std::sqrt(inside);
  return (nearest + (is_near_ ? -half : half) * ray.direction).normalized();
}

CutScene CutDrag::At(const Projection& projection, const Vector2d& at_px) const {
  CutScene scene = begun_;
  if (handle_.kind == CutHandle::Kind::kRim) {
    Turn(DirectionAt(projection, at_px - beside_px_), scene);
    return scene;
  }
  const double moved_mm =
      PlaceAlong({origin_D_, along_D_, begun_.scale}, projection, at_px) - taken_mm_;
  if (handle_.kind == CutHandle::Kind::kPlane) {
    ClipPlane& plane = scene.cuts.planes[handle_.number];
    const auto [least, most] = OffsetRange(plane.normal_I, scene.lattice_size);
    const double voxels_per_mm = CovectorInD(scene, plane.normal_I).norm();
    plane.offset_voxels = std::clamp(plane.offset_voxels + moved_mm * voxels_per_mm, least, most);
    return scene;
  }
  const auto axis = static_cast<int>(handle_.number / 2);
  const double edge_mm =
      scene.X_DI.linear.col(axis).norm() * static_cast<double>(scene.lattice_size[axis] + 1);
  Vec3& min = scene.cuts.crop.min;
  Vec3& max = scene.cuts.crop.max;
  if (handle_.number % 2 == 1) {
    max[axis] = std::clamp(max[axis] + moved_mm / edge_mm, min[axis] + kLeastCrop, 1.0);
  } else {
    min[axis] = std::clamp(min[axis] - moved_mm / edge_mm, 0.0, max[axis] - kLeastCrop);
  }
  return scene;
}

void CutDrag::Turn(const Vec3& direction_D, CutScene& scene) const {
  const Mat3 turn = Eigen::Quaterniond::FromTwoVectors(taken_D_, direction_D).toRotationMatrix();
  ClipPlane& plane = scene.cuts.planes[handle_.number];
  plane.normal_I = (scene.X_DI.linear.transpose() * (turn * along_D_)).normalized();
  Vec3& pivot_I = scene.pivots_I[handle_.number];
  pivot_I = scene.X_DI.Inverse().Apply(origin_D_);
  const auto [least, most] = OffsetRange(plane.normal_I, scene.lattice_size);
  plane.offset_voxels = std::clamp(plane.normal_I.dot(pivot_I), least, most);
}

void AddCropBox(const CutScene& scene, Overlay& overlay) {
  const CropBox& crop = scene.cuts.crop;
  AddBox(scene.X_DI, PointOfFractions(crop.min, scene.lattice_size),
         PointOfFractions(crop.max, scene.lattice_size), kCropColor, kCropBehind, overlay);
}

void AddCutHandles(const CutScene& scene, const std::optional<CutHandle>& lit,
                   const Projection& projection, Overlay& overlay) {
  for (const CutHandle& handle : HandlesOf(scene)) {
    const Arrow arrow = ArrowOf(scene, handle);
    const auto& color = lit == handle ? kLitColor : kHandleColor;
    if (handle.kind == CutHandle::Kind::kRim) {
      AddRim(arrow, color, projection, overlay);
    } else {
      AddArrow(arrow, color, projection, overlay);
    }
  }
}

namespace {

double VoxelsPerMm(const Vec3& normal_I, const AffineMap& X_WI) {
  return (X_WI.Inverse().linear.transpose() * normal_I).norm();
}

double OffsetOfMiddle(const Vec3& normal_I, const Vec3i& lattice_size) {
  return 0.5 * normal_I.dot((lattice_size - Vec3i::Ones()).cast<double>());
}

}  // namespace

std::array<CutRuler, 3> RulersOf(const AffineMap& X_PI, const Vec3i& lattice_size) {
  const PatientAxes axes = NearestAxes(X_PI.linear);
  std::array<CutRuler, 3> rulers;
  for (std::size_t n = 0; n < rulers.size(); ++n) {
    const SignedAxis& along_I = axes[n];
    const Vec3 unit_P = along_I.sign * X_PI.linear.col(along_I.axis).normalized();
    const auto at = [&](double fraction) {
      Vec3 p_I = Vec3::Zero();
      p_I[along_I.axis] = PointOfFractions(Vec3::Constant(fraction), lattice_size)[along_I.axis];
      return unit_P.dot(X_PI.Apply(p_I));
    };
    rulers[n] = {.along_I = along_I,
                 .begin_mm = at(along_I.sign > 0 ? 0.0 : 1.0),
                 .end_mm = at(along_I.sign > 0 ? 1.0 : 0.0)};
  }
  return rulers;
}

std::array<double, 2> FacesOnRuler(const CropBox& crop, const CutRuler& ruler) {
  const int axis = ruler.along_I.axis;
  const double length_mm = ruler.end_mm - ruler.begin_mm;
  if (ruler.along_I.sign > 0) {
    return {ruler.begin_mm + crop.min[axis] * length_mm,
            ruler.begin_mm + crop.max[axis] * length_mm};
  }
  return {ruler.end_mm - crop.max[axis] * length_mm, ruler.end_mm - crop.min[axis] * length_mm};
}

void SetFacesOnRuler(const std::array<double, 2>& faces_mm, const CutRuler& ruler, CropBox& crop) {
  const int axis = ruler.along_I.axis;
  const double length_mm = ruler.end_mm - ruler.begin_mm;
  double low = (faces_mm[0] - ruler.begin_mm) / length_mm;
  double high = (faces_mm[1] - ruler.begin_mm) / length_mm;
  if (ruler.along_I.sign < 0) {
    low = (ruler.end_mm - faces_mm[1]) / length_mm;
    high = (ruler.end_mm - faces_mm[0]) / length_mm;
  }
  crop.min[axis] = std::clamp(low, 0.0, 1.0 - kLeastCrop);
  crop.max[axis] = std::clamp(high, crop.min[axis] + kLeastCrop, 1.0);
}

double DistanceOfPlane(double offset_voxels, const Vec3& normal_I, const AffineMap& X_WI,
                       const Vec3i& lattice_size) {
  return (offset_voxels - OffsetOfMiddle(normal_I, lattice_size)) / VoxelsPerMm(normal_I, X_WI);
}

double OffsetOfPlane(double distance_mm, const Vec3& normal_I, const AffineMap& X_WI,
                     const Vec3i& lattice_size) {
  return distance_mm * VoxelsPerMm(normal_I, X_WI) + OffsetOfMiddle(normal_I, lattice_size);
}

}  // namespace palpate::view
