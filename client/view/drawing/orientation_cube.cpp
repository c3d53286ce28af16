#include "client/view/drawing/orientation_cube.h"

#include <algorithm>
#include <cmath>

namespace palpate::view {
namespace {

// Half an edge, so that a corner is 1 from the middle.
const double kHalf = 1.0 / std::sqrt(3.0);
// Thinner faces cannot be read or clicked.
constexpr double kLeastFacing = 0.05;
// The sides of kPatientViews.
constexpr std::array<SignedAxis, 6> kSides_U = {
    {{2, 1}, {2, -1}, {0, 1}, {0, -1}, {1, 1}, {1, -1}}};

Eigen::Vector2d InPicture(const Vec3& p_V) { return {p_V.x(), -p_V.y()}; }

double Cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

bool Contains(const CubeFace& face, const Eigen::Vector2d& point) {
  bool left = false, right = false;
  for (std::size_t n = 0; n < 4; ++n) {
    const double side = Cross(face.corners[(n + 1) % 4] - face.corners[n], point - face.corners[n]);
    left = left || side > 0.0;
    right = right || side < 0.0;
  }
  return !(left && right);
}

}  // namespace

std::vector<CubeFace> SeenFaces(const Mat3& R_VW) {
  std::vector<CubeFace> faces;
  for (int n = 0; n < 6; ++n) {
    const SignedAxis direction{n / 2, n % 2 == 0 ? 1 : -1};
    const Vec3 out_V = direction.sign * R_VW.col(direction.axis);
    if (out_V.z() < kLeastFacing) continue;
    const Vec3 a_V = R_VW.col((direction.axis + 1) % 3);
    const Vec3 b_V = R_VW.col((direction.axis + 2) % 3);
    CubeFace face{.direction_W = direction,
                  .corners = {},
                  .middle = InPicture(kHalf * out_V),
                  .facing = out_V.z()};
    constexpr std::array<std::array<int, 2>, 4> kAround = {{{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}};
    for (std::size_t corner = 0; corner < 4; ++corner) {
      face.corners[corner] =
          InPicture(kHalf * (out_V + kAround[corner][0] * a_V + kAround[corner][1] * b_V));
    }
    faces.push_back(face);
  }
  return faces;
}

std::optional<SignedAxis> FaceAt(const std::vector<CubeFace>& faces, const Eigen::Vector2d& point) {
  for (const CubeFace& face : faces) {
    if (Contains(face, point)) return face.direction_W;
  }
  return std::nullopt;
}

std::string FaceText(const SignedAxis& direction_W, bool of_patient) {
  if (of_patient) return {LetterOf(direction_W)};
  return {direction_W.sign > 0 ? '+' : '-', "xyz"[direction_W.axis]};
}

Mat3 UprightVolume(const Mat3& D_from_I, const Mat3& W_from_I) {
  const Mat3 D_from_W = D_from_I * W_from_I.inverse();
  const PatientAxes nearest = NearestAxes(D_from_W);
  const auto along = [&](std::size_t axis) {
    return Vec3(nearest[axis].sign * D_from_W.col(nearest[axis].axis).normalized());
  };
  Mat3 R_DU;
  R_DU.col(0) = along(0);
  R_DU.col(1) = along(1);
  R_DU.col(2) = R_DU.col(0).cross(R_DU.col(1));
  return R_DU;
}

SideView LookFromSide(const Vec3& direction_U, bool of_patient) {
  const auto towards = [&](const SignedAxis& side_U) {
    return side_U.sign * direction_U[side_U.axis];
  };
  const auto nearest = std::ranges::max_element(kSides_U, {}, towards);
  const PatientView& view = kPatientViews[static_cast<std::size_t>(nearest - kSides_U.begin())];
  const bool is_top = nearest->axis == 1 && nearest->sign > 0;
  return {is_top && !of_patient ? 0.0 : view.azimuth_deg, view.elevation_deg};
}

SignedAxis SideOfKey(int key, bool of_patient) {
  const SignedAxis& side_U = kSides_U[static_cast<std::size_t>(std::clamp(key, 1, 6) - 1)];
  // A patient's left is at the viewer's right.
  return side_U.axis == 0 && !of_patient ? -side_U : side_U;
}

}  // namespace palpate::view
