#include "client/view/drawing/patient_axes.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace palpate::view {

std::optional<Mat3> PatientFromWorld(std::string_view patient_axes) {
  constexpr std::string_view kPositive = "LPS", kNegative = "RAI";
  if (patient_axes.size() != 3) return std::nullopt;
  Mat3 P_from_W = Mat3::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    const char letter = patient_axes[static_cast<std::size_t>(axis)];
    const std::size_t positive = kPositive.find(letter), negative = kNegative.find(letter);
    if (positive == kPositive.npos && negative == kNegative.npos) return std::nullopt;
    const bool is_positive = positive != kPositive.npos;
    P_from_W(static_cast<int>(is_positive ? positive : negative), axis) = is_positive ? 1.0 : -1.0;
  }
  if (P_from_W.determinant() != 1.0) return std::nullopt;
  return P_from_W;
}

PatientFrame PatientFrameOf(const ViewVolume& volume) {
  const AffineMap& X_WI = volume.lattice()->X_WI;
  const std::optional<Mat3> P_from_W = PatientFromWorld(volume.patient_axes());
  if (!P_from_W) return {false, X_WI};
  return {true, {*P_from_W * X_WI.linear, *P_from_W * X_WI.translation}};
}

PatientAxes NearestAxes(const Mat3& P_from_I) {
  // Spacings must not decide.
  const Mat3 cosines = P_from_I.colwise().normalized();
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
  const auto in_volume = [&](const SignedAxis& direction_P) {
    const SignedAxis& axis_I = axes[static_cast<std::size_t>(direction_P.axis)];
    return direction_P.sign > 0 ? axis_I : -axis_I;
  };
  const SliceAxes slice = SliceInWorld(world_axis, side);
  return {in_volume(slice.across), in_volume(slice.right), in_volume(slice.down)};
}

char LetterOf(const SignedAxis& direction_P) {
  return (direction_P.sign > 0 ? "LPS" : "RAI")[direction_P.axis];
}

std::string LettersOf(const Vec3& direction_P) {
  static const double kLeast = std::sin(std::numbers::pi / 8.0);
  const Vec3 unit = direction_P.normalized();
  std::array<int, 3> axes = {0, 1, 2};
  // Components that are equal but for rounding stay in the order L, P, S.
  std::ranges::stable_sort(
      axes, [&](int a, int b) { return std::abs(unit[a]) > std::abs(unit[b]) + 1e-6; });
  std::string letters;
  for (const int axis : axes) {
    if (std::abs(unit[axis]) >= kLeast) letters += LetterOf({axis, unit[axis] < 0.0 ? -1 : 1});
  }
  return letters;
}

std::string PlaneName(int patient_axis, const Mat3& P_from_I) {
  static constexpr std::array<const char*, 3> kNames = {"sagittal", "coronal", "axial"};
  const int across = NearestAxes(P_from_I)[static_cast<std::size_t>(patient_axis)].axis;
  const Vec3 normal =
      P_from_I.col((across + 1) % 3).cross(P_from_I.col((across + 2) % 3)).normalized();
  const double angle_deg =
      std::acos(std::min(1.0, std::abs(normal[patient_axis]))) * 180.0 / std::numbers::pi;
  if (angle_deg <= kOblique_deg) return kNames[static_cast<std::size_t>(patient_axis)];
  return fmt::format("oblique {:.0f}°", angle_deg);
}

Mat3 UprightPatient(const Mat3& D_from_I, const Mat3& P_from_I) {
  const Mat3 D_from_P = D_from_I * P_from_I.inverse();
  Mat3 R_DU;
  R_DU.col(1) = D_from_P.col(2).normalized();
  R_DU.col(0) = D_from_P.col(0).normalized();
  R_DU.col(2) = R_DU.col(0).cross(R_DU.col(1));
  return R_DU;
}

}  // namespace palpate::view
