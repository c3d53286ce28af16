#include "client/view/drawing/orientation_cube.h"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <set>
#include <string>

#include "tests/support/orientations.h"

namespace palpate::view {
namespace {

class CubeDice {
 public:
  double Between(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  Vec3 Direction() { return Vec3(Between(-1, 1), Between(-1, 1), Between(-1, 1)).normalized(); }
  Mat3 Turn() { return Eigen::AngleAxisd(Between(0, 6), Direction()).toRotationMatrix(); }

 private:
  std::mt19937 random_{5};
};

// The face that a ray along the view hits first, by exact geometry.
std::optional<SignedAxis> FaceByRay(const Mat3& R_VW, const Eigen::Vector2d& point) {
  const double half = 1.0 / std::sqrt(3.0);
  const Mat3 R_WV = R_VW.inverse();
  const Vec3 origin = R_WV * Vec3(point.x(), -point.y(), 10.0);
  const Vec3 way = R_WV * Vec3(0.0, 0.0, -1.0);
  double nearest = 1e9;
  std::optional<SignedAxis> face;
  for (int axis = 0; axis < 3; ++axis) {
    for (const int sign : {-1, 1}) {
      const double at = (sign * half - origin[axis]) / way[axis];
      const Vec3 p = origin + at * way;
      bool is_in = at > 0.0 && at < nearest;
      for (int other = 0; other < 3; ++other) {
        if (other != axis) is_in = is_in && std::abs(p[other]) <= half;
      }
      if (!is_in) continue;
      nearest = at;
      face = SignedAxis{axis, sign};
    }
  }
  return face;
}

TEST(ViewOrientationCube, APointShowsTheFaceThatARayHits) {
  CubeDice dice;
  int hits = 0;
  for (int n = 0; n < 20000; ++n) {
    Mat3 R_VW = dice.Turn();
    if (n % 2) R_VW.col(0) *= -1.0;  // a mirrored volume
    const Eigen::Vector2d point(dice.Between(-1.1, 1.1), dice.Between(-1.1, 1.1));
    const auto seen = FaceAt(SeenFaces(R_VW), point);
    const auto by_ray = FaceByRay(R_VW, point);
    // Faces that are almost edge on are left out.
    if (by_ray && std::abs(R_VW(2, by_ray->axis)) < 0.06) continue;
    EXPECT_EQ(seen, by_ray) << n;
    hits += by_ray.has_value();
  }
  EXPECT_GT(hits, 5000);
}

TEST(ViewOrientationCube, CornersAreWithinOneOfTheMiddle) {
  CubeDice dice;
  for (int n = 0; n < 1000; ++n) {
    const auto faces = SeenFaces(dice.Turn());
    EXPECT_GE(faces.size(), 1u);
    EXPECT_LE(faces.size(), 3u);
    for (const CubeFace& face : faces) {
      for (const auto& corner : face.corners) EXPECT_LE(corner.norm(), 1.0 + 1e-12);
    }
  }
}

TEST(ViewOrientationCube, ThePatientsFacesHaveTheirLetters) {
  std::set<std::string> texts;
  for (int axis = 0; axis < 3; ++axis) {
    for (const int sign : {-1, 1}) texts.insert(FaceText({axis, sign}, true));
  }
  EXPECT_EQ(texts, (std::set<std::string>{"L", "R", "A", "P", "S", "I"}));
  EXPECT_EQ(FaceText({1, -1}, true), "A");
  EXPECT_EQ(FaceText({1, -1}, false), "-y");
  EXPECT_EQ(FaceText({2, 1}, false), "+z");
}

// The face in the middle of the cube, and the one that is up, after a key.
struct Look {
  SignedAxis middle;
  SignedAxis up;
};

Look LookAfterKey(int key, bool of_patient, const Mat3& D_from_I, const Mat3& W_from_I) {
  Camera camera;
  camera.SetUpright(of_patient ? UprightPatient(D_from_I, W_from_I)
                               : UprightVolume(D_from_I, W_from_I));
  const SignedAxis side = SideOfKey(key, of_patient);
  const SideView look = LookFromSide(side.sign * Vec3::Unit(side.axis), of_patient);
  camera.Set(Vec3::Zero(), look.azimuth_deg, look.elevation_deg, 100.0);
  const Mat3 D_from_W = D_from_I * W_from_I.inverse();
  const Mat3 R_VW = (camera.X_VD().linear * D_from_W).colwise().normalized();
  const auto nearest = [&](int row) {
    int axis = 0;
    R_VW.row(row).cwiseAbs().maxCoeff(&axis);
    return SignedAxis{axis, R_VW(row, axis) > 0.0 ? 1 : -1};
  };
  return {nearest(2), nearest(1)};
}

TEST(ViewOrientationCube, KeysLookFromTheSidesOfAPatientInAnyOrientationAndPlace) {
  CubeDice dice;
  const std::map<int, std::string> from = {{1, "A"}, {2, "P"}, {3, "L"},
                                           {4, "R"}, {5, "S"}, {6, "I"}};
  for (const Mat3& orientation : testing::Orientations()) {
    const Mat3 W_from_I = orientation * Vec3(0.3, 1.0, 4.0).asDiagonal();
    const Mat3 D_from_I = 0.7 * dice.Turn() * W_from_I;
    for (const auto& [key, letter] : from) {
      const Look look = LookAfterKey(key, true, D_from_I, W_from_I);
      EXPECT_EQ(FaceText(look.middle, true), letter);
      EXPECT_EQ(FaceText(look.up, true), key < 5 ? "S" : "A");
    }
  }
}

TEST(ViewOrientationCube, KeysLookFromTheSidesOfOtherThingsAsTheyStand) {
  // y of the volume is up, z to the front: as D.
  const Mat3 same = Mat3::Identity();
  const std::map<int, std::string> from = {{1, "+z"}, {2, "-z"}, {3, "-x"},
                                           {4, "+x"}, {5, "+y"}, {6, "-y"}};
  for (const auto& [key, side] : from) {
    EXPECT_EQ(FaceText(LookAfterKey(key, false, same, same).middle, false), side);
  }
  // Turned a little: the same sides, seen straight ahead.
  const Mat3 turned = Eigen::AngleAxisd(0.3, Vec3(1, 2, 3).normalized()).toRotationMatrix();
  for (const auto& [key, side] : from) {
    EXPECT_EQ(FaceText(LookAfterKey(key, false, turned, same).middle, false), side);
  }
  EXPECT_LT((UprightVolume(turned, same) - turned).norm(), 1e-12);
}

TEST(ViewOrientationCube, AnUprightVolumeIsARotationWhateverTheVolume) {
  CubeDice dice;
  for (const Mat3& orientation : testing::Orientations()) {
    const Mat3 W_from_I = orientation * Vec3(0.3, 1.0, 4.0).asDiagonal();
    const Mat3 R_DU = UprightVolume(2.0 * dice.Turn() * W_from_I, W_from_I);
    EXPECT_TRUE((R_DU * R_DU.transpose()).isIdentity(1e-9));
    EXPECT_GT(R_DU.determinant(), 0.0);
  }
}

}  // namespace
}  // namespace palpate::view
