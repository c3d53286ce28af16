#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <map>
#include <random>
#include <set>
#include <sstream>
#include <string>
#include <string_view>

#include "client/view/drawing/camera.h"
#include "client/view/drawing/orientation_cube.h"
#include "tests/support/orientations.h"
#include "tests/support/places.h"

namespace palpate::view {
namespace {

const Vec3 kSpacing_mm = {0.3, 1.0, 4.0};

Vec3 Direction(const SignedAxis& axis) { return axis.sign * Vec3::Unit(axis.axis); }

void ExpectSameDirection(const SignedAxis& axis_I, const SignedAxis& axis_W, const Mat3& W_from_I) {
  EXPECT_EQ((W_from_I * Direction(axis_I)).normalized(), Direction(axis_W));
}

TEST(ViewPatientAxes, AreThoseOfEachOrientation) {
  for (const Mat3& orientation : testing::Orientations()) {
    const Mat3 W_from_I = orientation * kSpacing_mm.asDiagonal();
    const PatientAxes axes = NearestAxes(W_from_I);
    for (int axis = 0; axis < 3; ++axis) {
      ExpectSameDirection(axes[static_cast<std::size_t>(axis)], {axis, 1}, W_from_I);
    }
    for (const SliceSide side : {SliceSide::kRadiological, SliceSide::kNeurological}) {
      for (int axis = 0; axis < 3; ++axis) {
        const SliceAxes in_volume = SliceInVolume(axis, side, axes);
        const SliceAxes in_world = SliceInWorld(axis, side);
        ExpectSameDirection(in_volume.across, in_world.across, W_from_I);
        ExpectSameDirection(in_volume.right, in_world.right, W_from_I);
        ExpectSameDirection(in_volume.down, in_world.down, W_from_I);
      }
    }
  }
}

// Less than half of a right angle changes no axis, whatever the spacing.
TEST(ViewPatientAxes, OfAnObliqueVolumeAreTheNearest) {
  for (const Mat3& orientation : testing::Orientations()) {
    const PatientAxes axes = NearestAxes(orientation);
    for (const Vec3& about : {Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1), Vec3(3, -2, 1)}) {
      const Mat3 turn = Eigen::AngleAxisd(0.7, about.normalized()).toRotationMatrix();
      EXPECT_EQ(NearestAxes(turn * orientation * kSpacing_mm.asDiagonal()), axes);
    }
  }
}

// The row by row nearest axis of I would be the first for two axes of W.
TEST(ViewPatientAxes, UseEachAxisOfTheVolumeOnce) {
  Mat3 W_from_I;
  W_from_I << 0.75, 0.6, 0.0, 0.65, 0.4, -0.65, 0.1, 0.7, 0.76;
  EXPECT_EQ(NearestAxes(W_from_I), (PatientAxes{SignedAxis{0, 1}, {2, -1}, {1, 1}}));
}

TEST(ViewPatientAxes, ATieDoesNotDependOnRounding) {
  for (const double little : {-1e-12, 0.0, 1e-12}) {
    const Mat3 turn =
        Eigen::AngleAxisd(0.25 * std::acos(-1.0) + little, Vec3::UnitZ()).toRotationMatrix();
    EXPECT_EQ(NearestAxes(turn), (PatientAxes{SignedAxis{0, 1}, {1, 1}, {2, 1}}));
  }
}

// Letters at the left, right, top and bottom.
std::string Letters(int axis, SliceSide side) {
  const SliceAxes slice = SliceInWorld(axis, side);
  return {LetterOf(-slice.right), LetterOf(slice.right), LetterOf(-slice.down),
          LetterOf(slice.down)};
}

TEST(ViewPatientAxes, SlicesAreAsRadiologistsOrNeurologistsHaveThem) {
  EXPECT_EQ(Letters(0, SliceSide::kRadiological), "APSI");
  EXPECT_EQ(Letters(1, SliceSide::kRadiological), "RLSI");
  EXPECT_EQ(Letters(2, SliceSide::kRadiological), "RLAP");
  EXPECT_EQ(Letters(0, SliceSide::kNeurological), "APSI");
  EXPECT_EQ(Letters(1, SliceSide::kNeurological), "LRSI");
  EXPECT_EQ(Letters(2, SliceSide::kNeurological), "LRAP");
}

// Which side of the patient is nearest to the eye, which is up, and which is right; as letters.
std::string Sees(const Camera& camera, const Mat3& D_from_W) {
  const AffineMap X_VD = camera.X_VD();
  std::string letters;
  for (const int row : {2, 1, 0}) {
    const Vec3 direction_W = D_from_W.transpose() * X_VD.linear.row(row).transpose();
    int axis = 0;
    EXPECT_GT(direction_W.cwiseAbs().maxCoeff(&axis), 0.999 * direction_W.norm());
    letters += LetterOf({axis, direction_W[axis] < 0.0 ? -1 : 1});
  }
  return letters;
}

TEST(ViewPatientAxes, EachViewShowsItsSideUpright) {
  const std::map<std::string_view, std::string> expected = {
      {"anterior", "ASL"}, {"posterior", "PSR"}, {"left", "LSP"},
      {"right", "RSA"},    {"superior", "SAR"},  {"inferior", "IAL"}};
  const Mat3 placed = 0.4 * Eigen::AngleAxisd(2.0, Vec3(3, -2, 1).normalized()).toRotationMatrix();
  for (const Mat3& D_from_W : {Mat3(0.4 * Mat3::Identity()), placed}) {
    for (const Mat3& orientation : testing::Orientations()) {
      const Mat3 W_from_I = orientation * kSpacing_mm.asDiagonal();
      Camera camera;
      camera.SetUpright(UprightPatient(D_from_W * W_from_I, W_from_I));
      for (const PatientView& view : kPatientViews) {
        camera.Set(Vec3::Zero(), view.azimuth_deg, view.elevation_deg, 100.0);
        EXPECT_EQ(Sees(camera, D_from_W), expected.at(view.name)) << view.name;
      }
    }
  }
}

TEST(ViewPatientAxes, AnAnswerTurnsTheWorldByRightAngles) {
  // Columns: where x, y and z of W point in LPS.
  Mat3 of_ila;
  of_ila << 0, 1, 0, 0, 0, -1, -1, 0, 0;
  EXPECT_EQ(PatientFromWorld("LPS"), Mat3(Mat3::Identity()));
  EXPECT_EQ(PatientFromWorld("RAS"), Mat3(Vec3(-1, -1, 1).asDiagonal()));
  EXPECT_EQ(PatientFromWorld("ILA"), of_ila);
  // Not known, mirrored, and no axes.
  for (const char* const none : {"", "RPS", "LLS", "LP", "LPSS", "XYZ"}) {
    EXPECT_FALSE(PatientFromWorld(none).has_value()) << none;
  }
}

Mat3 Turn(double degrees, const Vec3& about) {
  return Eigen::AngleAxisd(degrees * std::acos(-1.0) / 180.0, about.normalized())
      .toRotationMatrix();
}

TEST(ViewPatientAxes, ObliqueDirectionsHaveTheLettersOfTheirGreatComponents) {
  EXPECT_EQ(LettersOf({3.0, 0.0, 0.0}), "L");
  EXPECT_EQ(LettersOf({0.0, 0.0, -0.1}), "I");
  EXPECT_EQ(LettersOf(Turn(22.0, Vec3::UnitZ()) * Vec3::UnitX()), "L");
  EXPECT_EQ(LettersOf(Turn(23.0, Vec3::UnitZ()) * Vec3::UnitX()), "LP");
  EXPECT_EQ(LettersOf(Turn(-50.0, Vec3::UnitZ()) * Vec3::UnitX()), "AL");
  EXPECT_EQ(LettersOf({1.0, 1.0 + 1e-12, -1.0}), "LPI");
}

TEST(ViewPatientAxes, APlaneIsObliqueIfItsNormalIs) {
  for (const Mat3& orientation : testing::Orientations()) {
    const auto name = [&](int axis, const Mat3& turn) {
      return PlaneName(axis, turn * orientation * kSpacing_mm.asDiagonal());
    };
    const Mat3 little = Turn(1.5, Vec3(1, 2, 3)), pitch = Turn(-31.2, Vec3::UnitX());
    EXPECT_EQ(name(0, little), "sagittal");
    EXPECT_EQ(name(1, little), "coronal");
    EXPECT_EQ(name(2, little), "axial");
    // A pitch about the axis from right to left turns sagittal planes in themselves.
    EXPECT_EQ(name(0, pitch), "sagittal");
    EXPECT_EQ(name(1, pitch), "oblique 31°");
    EXPECT_EQ(name(2, pitch), "oblique 31°");
  }
}

// The page's test reads the same table.
TEST(ViewPatientAxes, WindowAndPageCallTheDirectionsOfAVolumeTheSame) {
  std::ifstream table(test::kPatientLetters);
  int volumes = 0;
  for (std::string line; std::getline(table, line);) {
    if (line.empty() || line[0] == '#') continue;
    ++volumes;
    std::istringstream words(line);
    Mat3 P_from_I;
    for (int column = 0; column < 3; ++column) {
      for (int row = 0; row < 3; ++row) words >> P_from_I(row, column);
    }
    const auto expect = [&](SignedAxis axis_I) {
      std::string letters;
      words >> letters;
      EXPECT_EQ(LettersOf(axis_I.sign * P_from_I.col(axis_I.axis)), letters) << line;
    };
    for (const int axis : {0, 1, 2}) {
      expect({axis, 1});
      expect({axis, -1});
    }
    for (const int world : {2, 1, 0}) {
      const SliceAxes slice = SliceInVolume(world, SliceSide::kRadiological, NearestAxes(P_from_I));
      for (const SignedAxis& right : {-slice.right, slice.right}) expect(right);
      for (const SignedAxis& down : {-slice.down, slice.down}) expect(down);
    }
  }
  EXPECT_EQ(volumes, 10);
}

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
