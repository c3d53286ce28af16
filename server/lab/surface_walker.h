// A point that walks on the trilinear isosurface V, as a fingertip would.
//
// The point moves along the tangent with a slowly turning heading. It returns to V along the
// gradient, in steps that are small compared to a voxel. It turns round before it reaches the
// border. If V is too rough to walk on, the point stops; Restart() puts it elsewhere.
//
// Frame: W, the volume's world (mm). The same seed gives the same walk.
// Threads: one. Errors: Error (kInvalidArgument) if no place to start is found.
#pragma once

#include <cstdint>
#include <optional>
#include <random>

#include "server/volume/snapshot/snapshot.h"

namespace palpate::lab {

class SurfaceWalker {
 public:
  // Borrows the volume. `isovalue`: normalised. `lift_mm`: how far above V the space must be free
  // at the start.
  SurfaceWalker(const VolumeSnapshot& volume, double isovalue, double lift_mm, std::uint64_t seed);

  // Walks along V. False if the point is stuck.
  bool Walk(double length_mm);
  void Restart();

  const Vec3& p_mm() const { return p_mm_; }
  // Unit length, towards lower density; averaged over about a voxel of the walk.
  Vec3 normal() const { return normal_.normalized(); }

 private:
  struct Foot {
    bool found = false;
    Vec3 p_mm = Vec3::Zero();
    Vec3 normal = Vec3::Zero();
  };

  std::optional<Vec3> FindFromBorder();
  Foot FindFoot(Vec3 p_mm, double reach_mm) const;
  bool IsFreeAbove(const Foot& foot) const;
  bool IsInside(const Vec3& p_mm, const Vec3& margin_voxels) const;
  bool Step(double length_mm);
  bool TryHeading(const Vec3& heading, double length_mm);
  double Random(double low, double high);

  const VolumeSnapshot& volume_;
  const double isovalue_;
  const double lift_mm_;
  AffineMap X_WI_;
  AffineMap X_IW_;
  double voxel_mm_;
  Vec3 margin_voxels_ = Vec3::Zero();
  std::mt19937_64 random_;
  Vec3 p_mm_ = Vec3::Zero();
  Vec3 foot_normal_ = Vec3::UnitZ();
  Vec3 normal_ = Vec3::UnitZ();
  Vec3 heading_ = Vec3::UnitX();
  double walked_mm_ = 0.0;
};

}  // namespace palpate::lab
