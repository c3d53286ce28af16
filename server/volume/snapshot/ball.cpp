#include "server/volume/snapshot/ball.h"

namespace palpate {
namespace {

constexpr double kTurnRounding = 1e-9;  // of a radius, after turns of the volume

}  // namespace

std::pair<double, double> BallRange(const Mat3& device_from_index) {
  const double voxel_mm = device_from_index.colwise().norm().minCoeff();
  return {kLeastBallVoxels * voxel_mm, kMostBallVoxels * voxel_mm};
}

bool CanBe(const Ball& ball) {
  const auto [low, high] = BallRange(ball.device_from_index);
  // Voxels that are sheared flat: the ball would hold many others.
  const double height_mm = 1.0 / ball.device_from_index.inverse().rowwise().norm().maxCoeff();
  return ball.radius_mm >= low * (1.0 - kTurnRounding) &&
         ball.radius_mm <= high * (1.0 + kTurnRounding) && height_mm >= low;
}

}  // namespace palpate
