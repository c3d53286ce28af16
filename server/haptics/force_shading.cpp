#include "server/haptics/force_shading.h"

#include <cmath>

namespace palpate {
namespace {

// Gradient of the felt density, as stored, at a vertex, by central differences. The padding is
// flat.
Vec3 VertexGradient(const VolumeSnapshot& volume, const Vec3i& vertex) {
  Vec3 gradient;
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3i step = Vec3i::Unit(axis);
    gradient[axis] =
        0.5 * (volume.StoredVertex(vertex + step) - volume.StoredVertex(vertex - step));
  }
  return gradient;
}

// Turns `wanted` to at most kMaxShadingAngleRad from `normal`. Both are unit vectors.
Vec3 WithinReach(const Vec3& wanted, const Vec3& normal) {
  const double cosine = wanted.dot(normal);
  if (cosine >= std::cos(kMaxShadingAngleRad)) return wanted;
  const Vec3 across = wanted - cosine * normal;
  const double length = across.norm();
  if (!(length > 0.0)) return normal;
  return std::cos(kMaxShadingAngleRad) * normal + (std::sin(kMaxShadingAngleRad) / length) * across;
}

}  // namespace

Vec3 ShadedNormal(const HapticSurface& surface, const Vec3& p_I, const Vec3& normal_D) noexcept {
  const Vec3i cell = p_I.array().floor().cast<int>();
  const Vec3 local = p_I - cell.cast<double>();
  Vec3 gradient_I = Vec3::Zero();
  for (const auto& o : kCornerOffset) {
    const double share = (o[0] ? local.x() : 1.0 - local.x()) *
                         (o[1] ? local.y() : 1.0 - local.y()) *
                         (o[2] ? local.z() : 1.0 - local.z());
    gradient_I += share * VertexGradient(*surface.volume, cell + Vec3i(o[0], o[1], o[2]));
  }
  const Vec3 down_D = -surface.sign() * (surface.X_ID.linear.transpose() * gradient_I);
  const double length = down_D.norm();
  return length > 0.0 ? WithinReach(down_D / length, normal_D) : normal_D;
}

}  // namespace palpate
