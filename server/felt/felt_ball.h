// The ball at the stylus's tip: the field that is felt in place of the volume, kept up to date with
// the volume's edits.
//
// A ball is felt with its radius on the device. The field is made in voxels: where the volume gets
// another scale, the ball has another radius until its field is made anew.
//
// Threads: plain values. Not for real-time code.
#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "server/haptics/settings.h"
#include "server/volume/snapshot/ball_field.h"

namespace palpate {

// A ball of this radius on a volume that lies so; none: a point.
std::optional<Ball> BallOf(double radius_mm, FreeSide side, const AffineMap& X_DI);
// Whether both have the same field, but for rounding.
bool HaveSameField(const Ball& one, const Ball& other);
// The radius, on the device, of a ball whose volume lies at X_DI now.
double RadiusMm(const Ball& ball, const AffineMap& X_DI);

class FeltBall {
 public:
  // Takes seconds for a large volume. `progress`: see BallField::Of.
  FeltBall(
      const Ball& ball, const VolumeSnapshot& volume,
      const std::function<void(double share)>& progress = [](double) {});

  // The most memory that Follow takes; none: the volume has another lattice, or so many other
  // bricks that it takes about as long as to begin anew.
  std::optional<std::uint64_t> BytesToFollow(const VolumeSnapshot& volume) const;
  // Goes on to the volume after edits. An earlier or another volume takes as long as the first.
  void Follow(const VolumeSnapshot& volume);

  // Takes the revisions of the same voxels after they have become the felt volume.
  void TakeRevisions(const VolumeSnapshot& volume);

  // The most memory that the field takes.
  static std::uint64_t MostBytes(const Ball& ball, const VolumeSnapshot& volume) {
    return BallField(ball).MostBytes(volume.size());
  }

  const Ball& ball() const { return ball_; }
  const std::shared_ptr<const VolumeSnapshot>& field() const { return field_; }
  FreeSide side() const { return ball_.is_least ? FreeSide::kAbove : FreeSide::kBelow; }
  // Where the field lies if its volume lies at X_DI.
  AffineMap PlaceOf(const AffineMap& X_DI) const;
  double RadiusMm(const AffineMap& X_DI) const { return palpate::RadiusMm(ball_, X_DI); }

 private:
  Ball ball_;
  std::shared_ptr<const BallField> maker_;
  std::shared_ptr<const VolumeSnapshot> field_;
};

}  // namespace palpate
