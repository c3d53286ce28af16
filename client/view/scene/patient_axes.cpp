#include "client/view/scene/patient_axes.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace palpate::view {

PatientAxes NearestAxes(const Mat3& W_from_I) {
  // Spacings must not decide.
  const Mat3 cosines = W_from_I.colwise().normalized();
  // A tie, as of a volume turned by 45°, must not depend on rounding.
  constexpr double kTie = 1e-6;
  std::array<int, 3> order = {0, 1, 2};
  std::array<int, 3> best = order;
  double best_sum = 0.0;
  do {
    double sum = 0.0;
    for (int axis = 0; axis < 3; ++axis)
      sum += std::abs(cosines(axis, order[static_cast<std::size_t>(axis)]));
    if (sum <= best_sum + kTie) continue;
    best_sum = sum;
    best = order;
  } while (std::next_permutation(order.begin(), order.end()));
  PatientAxes axes;
  for (int axis = 0; axis < 3; ++axis) {
    const int of_I = best[static_cast<std::size_t>(axis)];
    axes[static_cast<std::size_t>(axis)] = {of_I, cosines(axis, of_I) < 0.0 ? -1 : 1};
  }
  return axes;
}

SliceAxes SliceInWorld(int world_axis, SliceSide side) {
  constexpr SignedAxis kLeft{0, 1}, kPosterior{1, 1}, kSuperior{2, 1};
  SliceAxes slice{.across = {world_axis, 1}, .right = kLeft, .down = -kSuperior};
  if (world_axis == 0) slice.right = kPosterior;
  if (world_axis == 2) slice.down = kPosterior;
  if (world_axis != 0 && side == SliceSide::kNeurological) slice.right = -kLeft;
  return slice;
}

SliceAxes SliceInVolume(int world_axis, SliceSide side, const PatientAxes& axes) {
  const auto in_volume = [&](const SignedAxis& direction_W) {
    const SignedAxis& axis_I = axes[static_cast<std::size_t>(direction_W.axis)];
    return direction_W.sign > 0 ? axis_I : -axis_I;
  };
  const SliceAxes slice = SliceInWorld(world_axis, side);
  return {in_volume(slice.across), in_volume(slice.right), in_volume(slice.down)};
}

char LetterOf(const SignedAxis& direction_W) {
  return (direction_W.sign > 0 ? "LPS" : "RAI")[direction_W.axis];
}

Mat3 UprightPatient(const Mat3& D_from_I, const Mat3& W_from_I) {
  const Mat3 D_from_W = D_from_I * W_from_I.inverse();
  Mat3 R_DU;
  R_DU.col(1) = D_from_W.col(2).normalized();
  R_DU.col(0) = D_from_W.col(0).normalized();
  R_DU.col(2) = R_DU.col(0).cross(R_DU.col(1));
  return R_DU;
}

}  // namespace palpate::view
