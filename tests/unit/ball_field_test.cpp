// The field of a ball, against the greatest value on lines that are followed point by point.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "server/volume/snapshot/ball_field.h"
#include "tests/support/made_volume.h"

namespace palpate {
namespace {

constexpr double kRounding = 2e-7;  // of values up to 1 in floats

struct Case {
  double radius_mm;
  Vec3 spacing_mm = Vec3::Ones();
  bool is_sheared = false, is_least = false;
};

constexpr int kCases = 6;
Case CaseAt(int number) {
  const std::array<Case, kCases> cases = {{{0.4},
                                           {1.0, {1, 1, 1}, true},
                                           {3.7, {1, 1, 2.5}, false, true},
                                           {4.0},
                                           {2.2, {1, 1, 1}, true, true},
                                           {6.3}}};
  return cases[static_cast<std::size_t>(number)];
}

Ball BallOfCase(const Case& one) {
  Mat3 axes = one.spacing_mm.asDiagonal();
  if (one.is_sheared) axes << 1.0, 0.3, 0.0, 0.0, -0.7, 0.1, 0.2, 0.0, 1.4;  // and mirrored
  return {.radius_mm = one.radius_mm, .device_from_index = axes, .is_least = one.is_least};
}

std::shared_ptr<const VolumeSnapshot> Noise(const Vec3i& size, std::mt19937& random) {
  std::uniform_real_distribution<float> uniform;
  return testing::MakeVolume(size, [&](int, int, int) { return uniform(random); });
}

double ValueOrBackground(const VolumeSnapshot& volume, const Vec3i& p) {
  const bool is_there = (p.array() >= 0).all() && (p.array() < volume.size().array()).all();
  return is_there ? testing::ValueAt(volume, p) : volume.metadata().Background();
}

// The greatest value (`sign` 1) or the negative of the least on the part of a line of the lattice
// that is within the ball around `p`: of its vertices, and of its two ends.
double OnLine(const VolumeSnapshot& volume, const Vec3i& p, const Vec3i& column, int axis,
              const Ball& ball, double sign) {
  const auto distance = [&](double t) {
    Vec3 q = column.cast<double>();
    q[axis] = t;
    return (ball.device_from_index * q).norm();
  };
  const Vec3 along = ball.device_from_index.col(axis);
  const double middle =
      -(ball.device_from_index * column.cast<double>()).dot(along) / along.squaredNorm();
  double best = -1e9;
  if (distance(middle) > ball.radius_mm) return best;
  const auto take = [&](double t) {
    Vec3i low = column, high = column;
    low[axis] = static_cast<int>(std::floor(t));
    high[axis] = low[axis] + 1;
    const double share = t - low[axis];
    best = std::max(best, sign * ((1.0 - share) * ValueOrBackground(volume, p + low) +
                                  share * ValueOrBackground(volume, p + high)));
  };
  for (const double side : {-1.0, 1.0}) {
    double in = 0.0, out = 40.0;  // from the middle
    for (int n = 0; n < 100; ++n) {
      const double half = 0.5 * (in + out);
      (distance(middle + side * half) <= ball.radius_mm ? in : out) = half;
    }
    take(middle + side * in);
  }
  for (int t = -12; t <= 12; ++t) {
    if (distance(t) <= ball.radius_mm * (1.0 + 1e-12)) take(t);
  }
  return best;
}

double OnLines(const VolumeSnapshot& volume, const Vec3i& p, const Ball& ball) {
  const double sign = ball.is_least ? -1.0 : 1.0;
  double best = sign * ValueOrBackground(volume, p);
  for (int axis = 0; axis < 3; ++axis) {
    for (int a = -10; a <= 10; ++a) {
      for (int b = -10; b <= 10; ++b) {
        Vec3i column = Vec3i::Zero();
        column[(axis + 1) % 3] = a;
        column[(axis + 2) % 3] = b;
        best = std::max(best, OnLine(volume, p, column, axis, ball, sign));
      }
    }
  }
  return sign * best;
}

// Of the vertices that any point of the ball could have a share of.
double GreatestAround(const VolumeSnapshot& volume, const Vec3i& p, const Vec3i& reach,
                      double sign) {
  double best = -1e9;
  for (int i = -reach.x(); i <= reach.x(); ++i) {
    for (int j = -reach.y(); j <= reach.y(); ++j) {
      for (int k = -reach.z(); k <= reach.z(); ++k) {
        best = std::max(best, sign * ValueOrBackground(volume, p + Vec3i(i, j, k)));
      }
    }
  }
  return best;
}

class BallFieldCase : public ::testing::TestWithParam<int> {};

TEST_P(BallFieldCase, IsTheGreatestOrLeastValueOnTheLinesOfTheLattice) {
  std::mt19937 random(GetParam());
  const Ball ball = BallOfCase(CaseAt(GetParam()));
  const auto volume = Noise(Vec3i(19, 26, 33), random);
  const BallField field(ball);
  const auto felt = field.Of(*volume, 2, [](double) {});
  ASSERT_EQ(felt->size(), volume->size() + 2 * field.margin());
  const double sign = ball.is_least ? -1.0 : 1.0;
  // Points of the sphere are added to a small ball's lines.
  const bool has_points = ball.radius_mm < 3.0 * ball.device_from_index.colwise().norm().maxCoeff();
  int raised = 0;
  for (int n = 0; n < 300; ++n) {
    Vec3i p;
    for (int axis = 0; axis < 3; ++axis) p[axis] = static_cast<int>(random() % felt->size()[axis]);
    const double expected = OnLines(*volume, p - field.margin(), ball);
    const double more = sign * (testing::ValueAt(*felt, p) - expected);
    EXPECT_GE(more, -kRounding);
    if (has_points) {
      const double greatest = GreatestAround(*volume, p - field.margin(), field.reach(), sign);
      EXPECT_LE(sign * testing::ValueAt(*felt, p), greatest + kRounding);
    } else {
      EXPECT_LE(more, kRounding);
    }
    raised += more > kRounding;
  }
  EXPECT_LT(raised, has_points ? 250 : 1);
}

TEST_P(BallFieldCase, EditsGiveTheBitsOfTheWholeAndTellOnlyWhatTheyReach) {
  std::mt19937 random(GetParam());
  std::uniform_real_distribution<float> uniform;
  auto volume = Noise(Vec3i(40, 33, 90), random);
  const BallField field(BallOfCase(CaseAt(GetParam())));
  auto felt = field.Of(*volume, 2, [](double) {});
  for (int edit = 0; edit < 4; ++edit) {
    Vec3i from, end;
    for (int axis = 0; axis < 3; ++axis) {
      from[axis] = static_cast<int>(random() % (volume->size()[axis] - 5));
      end[axis] = from[axis] + 1 + static_cast<int>(random() % 5);
    }
    const auto changes =
        testing::PaintedBox(volume->bricks(), from, end, [&] { return uniform(random); });
    volume = testing::WithChanges(*volume, changes);
    std::vector<Vec3i> bricks;
    for (const BrickChange& change : changes) bricks.push_back(change.brick);
    const auto reached = field.ChangesOf(*volume, *felt, bricks, 2);
    for (const BrickChange& change : reached) {
      const Vec3i low = 8 * change.brick - field.margin() - field.reach();
      const Vec3i high = low + Vec3i::Constant(8) + 2 * field.reach();
      EXPECT_TRUE((low.array() < end.array()).all() && (high.array() > from.array()).all());
    }
    felt = testing::WithChanges(*felt, reached);
  }
  const auto whole = field.Of(*volume, 1, [](double) {});
  EXPECT_EQ(felt->bricks().content_hash(), whole->bricks().content_hash());
}

INSTANTIATE_TEST_SUITE_P(Balls, BallFieldCase, ::testing::Range(0, kCases));

// Differences of such values are infinite.
TEST(BallField, GreatValuesStayFinite) {
  const float great = std::numeric_limits<float>::max();
  const auto volume = testing::MakeVolume(Vec3i(20, 20, 20), [&](int i, int j, int k) {
    return (i * 7 + j * 5 + k * 3) % 11 < 5 ? great : -great;
  });
  for (const double radius_mm : {1.0, 3.3}) {
    for (const bool is_least : {false, true}) {
      const BallField field({.radius_mm = radius_mm, .is_least = is_least});
      const auto felt = field.Of(*volume, 1, [](double) {});
      for (int n = 0; n < 20; ++n) {
        const float value = testing::ValueAt(*felt, field.margin() + Vec3i::Constant(n));
        EXPECT_EQ(value, is_least ? -great : great);
      }
    }
  }
}

TEST(BallField, TellsHowFarItIsAndCanBeGivenUp) {
  const auto volume = testing::Gyroid(48);
  const BallField field({.radius_mm = 2.0});
  double last = -1.0;
  field.Of(*volume, 2, [&](double share) {
    EXPECT_GE(share, last);
    EXPECT_LT(share, 1.0);
    last = share;
  });
  EXPECT_GE(last, 0.0);
  EXPECT_THROW(field.Of(*volume, 2, [](double) { throw std::runtime_error("enough"); }),
               std::runtime_error);
}

}  // namespace
}  // namespace palpate
