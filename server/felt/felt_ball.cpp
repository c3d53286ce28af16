#include "server/felt/felt_ball.h"

#include <algorithm>
#include <cmath>
#include <thread>
#include <vector>

namespace palpate {
namespace {

constexpr double kRounding = 1e-9;  // of the shape of voxels, after turns of the volume

// With a ball of 8 voxels, half a second's work.
constexpr std::size_t kMostFollowed = 8192;
// The bricks that a brick reaches, itself included.
constexpr std::uint64_t kBricksAround = 27;

int Threads() { return static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 1u, 4u)); }

}  // namespace

std::optional<Ball> BallOf(double radius_mm, FreeSide side, const AffineMap& X_DI) {
  if (!(radius_mm > 0.0)) return std::nullopt;
  return Ball{.radius_mm = radius_mm,
              .device_from_index = X_DI.linear,
              .is_least = side == FreeSide::kAbove};
}

bool HaveSameField(const Ball& one, const Ball& other) {
  const auto metric = [](const Ball& ball) -> Mat3 {
    const Mat3 in_radii = ball.device_from_index / ball.radius_mm;
    return in_radii.transpose() * in_radii;
  };
  return one.is_least == other.is_least &&
         (metric(one) - metric(other)).norm() <= kRounding * metric(one).norm();
}

double RadiusMm(const Ball& ball, const AffineMap& X_DI) {
  return ball.radius_mm * (X_DI.linear.col(0).norm() / ball.device_from_index.col(0).norm());
}

FeltBall::FeltBall(const Ball& ball, const VolumeSnapshot& volume,
                   const std::function<void(double share)>& progress)
    : ball_(ball),
      maker_(std::make_shared<const BallField>(ball)),
      field_(maker_->Of(volume, Threads(), progress)) {}

std::optional<std::uint64_t> FeltBall::BytesToFollow(const VolumeSnapshot& volume) const {
  if (volume.loaded_revision() != field_->loaded_revision() ||
      volume.revision() < field_->revision()) {
    return std::nullopt;
  }
  const std::size_t changed = volume.bricks().ChangedSince(field_->revision()).size();
  if (changed > kMostFollowed) return std::nullopt;
  return std::min(kBricksAround * changed * Leaf::Bytes(LeafType::kFloat),
                  MostBytes(ball_, volume));
}

void FeltBall::Follow(const VolumeSnapshot& volume) {
  if (volume.revision() == field_->revision()) return;
  if (volume.loaded_revision() != field_->loaded_revision() ||
      volume.revision() < field_->revision()) {
    field_ = maker_->Of(volume, Threads(), [](double) {});
    return;
  }
  std::vector<Vec3i> changed;
  for (const std::uint64_t number : volume.bricks().ChangedSince(field_->revision())) {
    changed.push_back(volume.bricks().BrickOf(number));
  }
  const std::vector<BrickChange> changes = maker_->ChangesOf(volume, *field_, changed, Threads());
  field_ = std::make_shared<const VolumeSnapshot>(maker_->On(volume.metadata()),
                                                  field_->bricks().With(changes, volume.revision()),
                                                  volume.revision(), volume.loaded_revision());
}

void FeltBall::TakeRevisions(const VolumeSnapshot& volume) {
  field_ = std::make_shared<const VolumeSnapshot>(field_->metadata(),
                                                  field_->bricks().AllChangedAt(volume.revision()),
                                                  volume.revision(), volume.loaded_revision());
}

AffineMap FeltBall::PlaceOf(const AffineMap& X_DI) const {
  return {X_DI.linear, X_DI.Apply(-maker_->margin().cast<double>())};
}

}  // namespace palpate
