// What is felt of a volume: an isovalue or layers, by a point, a ball or a tool.
//
// Threads: pure functions. Errors: none.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "common/contract/render.h"
#include "server/felt/scene.h"
#include "server/haptics/settings.h"
#include "server/volume/snapshot/ball_field.h"

namespace palpate {

// A ball of this radius on a volume that lies so; none: a point.
std::optional<Ball> BallOf(double radius_mm, FreeSide side, const AffineMap& X_DI);
// Whether both have the same field, but for rounding.
bool HaveSameField(const Ball& one, const Ball& other);
// The radius, on the device, of a ball whose volume lies at X_DI now.
double RadiusMm(const Ball& ball, const AffineMap& X_DI);

// The ball at the stylus's tip: the field that is felt in place of the volume, kept up to date with
// the volume's edits.
//
// A ball is felt with its radius on the device. The field is made in voxels: where the volume gets
// another scale, the ball has another radius until its field is made anew.
//
// Threads: plain values. Not for real-time code.
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

// What is felt at the stylus: its tip, a ball, or a rigid tool, with the fields of their radii.
struct FeltTip {
  HeldTool tool{};  // without balls: none
  // Of a tool: for each of its radii above 0, in the order of RadiiOf. Else of the ball, if there
  // is one.
  std::vector<FeltBall> fields{};
  std::shared_ptr<ToolCaches> caches{};  // of a tool

  bool has_tool() const { return !tool.ball.empty(); }
  // The ball at the tip; null: none.
  const FeltBall* ball() const { return has_tool() || fields.empty() ? nullptr : &fields.front(); }
};

// The different radii of a tool's balls, in the order in which the balls name them first.
std::vector<double> RadiiOf(const HeldTool& tool);

// The fields that the settings' tip needs on a volume that lies so, in the order of FeltTip.
std::vector<Ball> FieldsOf(const HapticSettings& settings, const AffineMap& X_DI);

// Puts the settings' tip together of fields that were made. False, and `tip` stays, if one of them
// is not among `made`.
bool Assemble(const HapticSettings& settings, const AffineMap& X_DI,
              const std::vector<FeltBall>& made, FeltTip& tip);

// A tip whose fields are there. `caches`: of the tip before; new ones are made only if they lack.
FeltTip MakeTip(const HeldTool& tool, std::vector<FeltBall> fields,
                std::shared_ptr<ToolCaches> caches = {});

// The normalised density for an isovalue in data units: the largest density whose data value is not
// above the isovalue. So no density at or below it reads back above the isovalue.
double DensityOf(const VolumeSnapshot& volume, double isovalue);

// Makes the surface of a scene that has its volume and settings. `density`: of the one surface,
// which layers replace; they are in order (OrderLayers). `tip`: its fields are of the volume. While
// the field of another side is being made, the side of the tip's is felt.
void FeelSurface(const AffineMap& X_DI, double density, std::uint64_t geometry_revision,
                 const FeltTip& tip, Scene& scene);

}  // namespace palpate
