// A point that walks on the trilinear isosurface V, as a fingertip would.
//
// It goes along the tangent with a slowly turning heading and comes back to V along
// the gradient, in steps small to a voxel. Away from the border it turns round.
// Where V is too rough to go on it stops; Restart() puts it elsewhere.
//
// Frame: W, the volume's world (mm). The same seed gives the same walk.
// Threads: one. Errors: Error (kInvalidArgument) where no place to start is found.
#pragma once

#include <cstdint>
#include <optional>
#include <random>

#include "server/volume/snapshot.h"

namespace palpate::lab {

class SurfaceWalker {
 public:
  // Borrows the volume. `isovalue` normalised. lift_mm: how far above V there must
  // be free space where it starts.
  SurfaceWalker(const VolumeSnapshot& volume, double isovalue, double lift_mm, std::uint64_t seed);

  // Along V. False: stuck.
  bool Walk(double length_mm);
  void Restart();

  const Vec3& p_mm() const { return p_mm_; }
  // Towards lower density, unit; averaged over about a voxel of the way.
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
