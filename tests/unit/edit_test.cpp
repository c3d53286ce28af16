// Edits against an oracle that visits every voxel and knows nothing of bricks; and what an edit may
// not be.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "server/volume/edit/edit.h"
#include "tests/support/made_volume.h"
#include "tests/support/refusal.h"
#include "tests/support/voxels.h"

namespace palpate {

namespace {

using VolumePtr = std::shared_ptr<const VolumeSnapshot>;

VolumePtr Placed(const VolumePtr& volume, const Vec3& spacing_mm, const Vec3& origin_W_mm,
                 const Mat3& direction) {
  VolumeMetadata metadata = volume->metadata();
  metadata.spacing_mm = spacing_mm;
  metadata.origin_W_mm = origin_W_mm;
  metadata.direction = direction;
  return std::make_shared<VolumeSnapshot>(metadata, volume->bricks(), 1, 1);
}

VolumePtr RandomVolume(const Vec3i& size, unsigned seed) {
  std::mt19937 random(seed);
  return testing::MakeVolume(size, [&](int i, int j, int k) {
    if (i == 0 && j == 0) return k == 0 ? -1000.0 : k == 1 ? 2000.0 : 0.0;
    return std::uniform_real_distribution<double>(-1000, 2000)(random);
  });
}

using testing::ForEachVoxel;
using testing::ValueAt;

VolumePtr After(const VolumePtr& volume, const VolumeEdit& edit) {
  return testing::WithChanges(*volume, ApplyEdit(*volume, edit).changes);
}

double DistanceTo(const VolumeEdit& edit, const Vec3& p) {
  if (const auto* sphere = std::get_if<SphereShape>(&edit.shape)) {
    return std::max(0.0, (p - sphere->center).norm() - sphere->radius);
  }
  if (const auto* box = std::get_if<BoxShape>(&edit.shape)) {
    double square = 0.0;
    for (int a = 0; a < 3; ++a) {
      const double nearest = std::min(std::max(p[a], box->min[a]), box->max[a]);
      square += (p[a] - nearest) * (p[a] - nearest);
    }
    return std::sqrt(square);
  }
  const auto& capsule = std::get<CapsuleShape>(edit.shape);
  const Vec3 way = capsule.to - capsule.from;
  const double square = way.squaredNorm();
  const double share =
      square > 0.0 ? std::min(1.0, std::max(0.0, (p - capsule.from).dot(way) / square)) : 0.0;
  return std::max(0.0, (p - (capsule.from + share * way)).norm() - capsule.radius);
}

double Mean(const VolumeSnapshot& volume, const Vec3i& p) {
  double sum = 0.0;
  int count = 0;
  for (int n = 0; n < 27; ++n) {
    const Vec3i q = p + Vec3i(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
    if ((q.array() < 0).any() || (q.array() >= volume.size().array()).any()) continue;
    sum += ValueAt(volume, q);
    ++count;
  }
  return sum / count;
}

double Expected(const VolumeSnapshot& volume, const VolumeEdit& edit, double w, const Vec3i& p) {
  const double v = ValueAt(volume, p);
  const double toward = edit.operation == EditOperation::kSmooth ? Mean(volume, p) : edit.value;
  double result = 0.0;
  switch (edit.operation) {
    case EditOperation::kAdd:
      result = v + w * toward;
      break;
    case EditOperation::kSubtract:
      result = v - w * toward;
      break;
    case EditOperation::kSet:
      result = v + w * (toward - v);
      break;
    default:
      result = v + w * edit.strength * (toward - v);
      break;
  }
  return std::min(2000.0, std::max(-1000.0, result));
}

// Values, locality, changed box and count, and that no brick is changed in vain.
void CheckAgainstOracle(const VolumePtr& volume, const VolumeEdit& edit) {
  const EditResult result = ApplyEdit(*volume, edit);
  const VolumePtr after = testing::WithChanges(*volume, result.changes);
  const AffineMap X_FI =
      edit.frame == EditFrame::kWorld ? volume->metadata().WorldFromIndex() : AffineMap();
  Vec3i low = volume->size(), high = -Vec3i::Ones();
  std::uint64_t count = 0;
  ForEachVoxel(volume->size(), [&](const Vec3i& p) {
    const double distance = DistanceTo(edit, X_FI.Apply(p.cast<double>()));
    const double t = edit.falloff > 0.0 ? 1.0 - distance / edit.falloff : -1.0;
    const double w = distance == 0.0 ? 1.0 : t <= 0.0 ? 0.0 : t * t * (3.0 - 2.0 * t);
    const float was = ValueAt(*volume, p), is = ValueAt(*after, p);
    if (distance > edit.falloff + 1e-9) {
      ASSERT_EQ(was, is) << p.transpose();
    } else if (distance == 0.0 || edit.falloff > 1e-3) {
      ASSERT_NEAR(is, Expected(*volume, edit, w, p), 2e-3) << p.transpose();
    }
    if (was == is) return;
    ++count;
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  });
  ASSERT_EQ(result.changed_voxels, count);
  ASSERT_EQ(result.changed.has_value(), count > 0);
  if (count > 0) {
    EXPECT_EQ(result.changed->min, low);
    EXPECT_EQ(result.changed->max, high);
  }
  for (const BrickChange& change : result.changes) {
    EXPECT_FALSE(HaveSameValues(*change.values, *volume->bricks().At(change.brick)));
  }
}

// Voxels of the last bricks that lie beyond the lattice.
void CheckPaddingStays(const VolumePtr& volume, const EditResult& result) {
  for (const BrickChange& change : result.changes) {
    for (int n = 0; n < kBrickVoxels; ++n) {
      const Vec3i p = change.brick * kBrickEdge + Vec3i(n >> 6, n >> 3 & 7, n & 7);
      if ((p.array() < volume->size().array()).all()) continue;
      ASSERT_EQ((*change.values)[n], (*volume->bricks().At(change.brick))[n]);
    }
  }
}

constexpr EditOperation kOperations[] = {EditOperation::kAdd, EditOperation::kSubtract,
                                         EditOperation::kSet, EditOperation::kSmooth,
                                         EditOperation::kPaint};

class RandomEdits {
 public:
  RandomEdits(const VolumePtr& volume, unsigned seed) : volume_(volume), random_(seed) {}

  VolumeEdit Next(EditOperation operation) {
    VolumeEdit edit;
    edit.operation = operation;
    edit.frame = random_() % 2 ? EditFrame::kWorld : EditFrame::kIndex;
    scale_ = edit.frame == EditFrame::kWorld ? volume_->metadata().spacing_mm.mean() : 1.0;
    edit.value = Uniform(-900, 1900);
    if (operation == EditOperation::kAdd) edit.value = Uniform(-3000, 3000);
    edit.strength = random_() % 3 ? Uniform(0.01, 1.0) : 1.0;
    edit.falloff = random_() % 3 ? scale_ * Uniform(0.1, 8.0) : 0.0;
    const Vec3 a = Position(edit.frame), b = Position(edit.frame);
    const double radius = scale_ * Uniform(0.4, 9.0);
    switch (random_() % 3) {
      case 0:
        edit.shape = SphereShape{a, radius};
        break;
      case 1:
        edit.shape = BoxShape{a.cwiseMin(b), a.cwiseMax(b)};
        break;
      default:
        edit.shape = CapsuleShape{a, random_() % 8 ? b : a, radius};
        break;
    }
    return edit;
  }

 private:
  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  Vec3 Position(EditFrame frame) {
    const Vec3i& size = volume_->size();
    const Vec3 p_I(Uniform(0, size.x() - 1), Uniform(0, size.y() - 1), Uniform(0, size.z() - 1));
    return frame == EditFrame::kWorld ? volume_->metadata().WorldFromIndex().Apply(p_I) : p_I;
  }

  const VolumePtr volume_;
  std::mt19937 random_;
  double scale_ = 1.0;
};

TEST(EditTest, EveryOperationAgreesWithTheOracle) {
  const Mat3 turned = (Eigen::AngleAxisd(0.7, Vec3(1, 2, 3).normalized())).toRotationMatrix();
  Mat3 mirrored = Mat3::Zero();
  mirrored(0, 1) = -1, mirrored(1, 0) = 1, mirrored(2, 2) = -1;
  const VolumePtr plain = RandomVolume(Vec3i(34, 29, 21), 1);
  const VolumePtr volumes[] = {plain,
                               Placed(plain, Vec3(0.5, 0.75, 2.5), Vec3(-100, 30, 1e3), turned),
                               Placed(plain, Vec3(0.001, 0.002, 0.001), Vec3(0, 5, -7), mirrored)};
  unsigned seed = 0;
  for (const VolumePtr& volume : volumes) {
    for (const EditOperation operation : kOperations) {
      RandomEdits edits(volume, ++seed);
      for (int n = 0; n < 40; ++n) {
        SCOPED_TRACE(::testing::Message() << "seed " << seed << ", edit " << n);
        const VolumeEdit edit = edits.Next(operation);
        CheckAgainstOracle(volume, edit);
        CheckPaddingStays(volume, ApplyEdit(*volume, edit));
        if (HasFatalFailure()) return;
      }
    }
  }
}

TEST(EditTest, BlocksAgreeWithTheOracle) {
  const VolumePtr volume = RandomVolume(Vec3i(34, 29, 21), 2);
  std::mt19937 random(3);
  for (int n = 0; n < 60; ++n) {
    DenseBlock block;
    for (int a = 0; a < 3; ++a) {
      block.min[a] = static_cast<std::int64_t>(random() % volume->size()[a]);
      block.size[a] = 1 + static_cast<std::int64_t>(random() % (volume->size()[a] - block.min[a]));
    }
    std::uniform_real_distribution<float> value(-1000, 2000);
    for (std::int64_t v = 0; v < block.size.prod(); ++v) block.values.push_back(value(random));
    VolumeEdit edit{.shape = block, .operation = kOperations[random() % 3], .strength = 0.5};
    CheckPaddingStays(volume, ApplyEdit(*volume, edit));
    const VolumePtr after = After(volume, edit);
    ForEachVoxel(volume->size(), [&](const Vec3i& p) {
      const auto place = (p.cast<std::int64_t>() - block.min).eval();
      float expected = ValueAt(*volume, p);
      if ((place.array() >= 0).all() && (place.array() < block.size.array()).all()) {
        edit.value = block.values[static_cast<std::size_t>(
            place.x() + block.size.x() * (place.y() + block.size.y() * place.z()))];
        expected = static_cast<float>(Expected(*volume, edit, 1.0, p));
        if (edit.operation == EditOperation::kSet) expected = static_cast<float>(edit.value);
      }
      ASSERT_EQ(ValueAt(*after, p), expected);
    });
  }
}

TEST(EditTest, SetIsExactWithinAndUntouchedOutside) {
  const VolumePtr volume = RandomVolume(Vec3i(24, 24, 24), 4);
  const VolumePtr after =
      After(volume, {.shape = SphereShape{Vec3(12, 12, 12), 5.0}, .value = 0.1, .strength = 0.2});
  ForEachVoxel(volume->size(), [&](const Vec3i& p) {
    // In whole numbers: the boundary belongs to the sphere.
    const int square = (p - Vec3i(12, 12, 12)).squaredNorm();
    ASSERT_EQ(ValueAt(*after, p), square <= 25 ? 0.1f : ValueAt(*volume, p));
  });
}

TEST(EditTest, ABoxHoldsItsCorners) {
  const VolumePtr volume = RandomVolume(Vec3i(24, 24, 24), 5);
  const VolumeEdit edit{.shape = BoxShape{Vec3(7, 8, 9), Vec3(15, 16, 9)}, .value = 7.0};
  const EditResult result = ApplyEdit(*volume, edit);
  EXPECT_EQ(result.changed_voxels, 81u);
  EXPECT_EQ(result.changed->min, Vec3i(7, 8, 9));
  EXPECT_EQ(result.changed->max, Vec3i(15, 16, 9));
  EXPECT_EQ(result.changes.size(), 4u);
}

TEST(EditTest, TheFalloffIsASmoothstep) {
  const VolumePtr volume = Placed(
      testing::MakeVolume(Vec3i(40, 9, 9), [](int i, int, int) { return i == 39 ? 1.0 : 0.0; }),
      Vec3(0.5, 1, 1), Vec3(10, 0, 0), Mat3::Identity());
  const VolumeEdit edit{.shape = BoxShape{Vec3(10, -99, -99), Vec3(12, 99, 99)},
                        .frame = EditFrame::kWorld,
                        .operation = EditOperation::kPaint,
                        .value = 1.0,
                        .falloff = 4.0};
  const VolumePtr after = After(volume, edit);
  // x mm beyond the box at voxel 4 + 2x.
  EXPECT_EQ(ValueAt(*after, Vec3i(4, 4, 4)), 1.0f);
  EXPECT_FLOAT_EQ(ValueAt(*after, Vec3i(6, 4, 4)), 0.84375f);
  EXPECT_FLOAT_EQ(ValueAt(*after, Vec3i(8, 4, 4)), 0.5f);
  EXPECT_FLOAT_EQ(ValueAt(*after, Vec3i(10, 4, 4)), 0.15625f);
  EXPECT_EQ(ValueAt(*after, Vec3i(12, 4, 4)), 0.0f);
}

TEST(EditTest, ResultsAreHeldWithinTheRange) {
  const VolumePtr volume = RandomVolume(Vec3i(20, 20, 20), 6);
  for (const double value : {5000.0, -5000.0, 1e308, -1e308}) {
    for (const EditOperation operation : {EditOperation::kAdd, EditOperation::kSubtract}) {
      const VolumePtr after = After(volume, {.shape = SphereShape{Vec3(10, 10, 10), 5.0},
                                             .operation = operation,
                                             .value = value,
                                             .falloff = 3.0});
      const bool up = (value > 0) == (operation == EditOperation::kAdd);
      EXPECT_EQ(ValueAt(*after, Vec3i(10, 10, 10)), up ? 2000.0f : -1000.0f);
    }
  }
}

TEST(EditTest, SmoothingReadsTheStateBeforeAndLeavesOutWhatLiesBeyondTheLattice) {
  // An impulse on a corner where eight bricks meet: every neighbour gets the same.
  const Vec3i size(24, 24, 24);
  const VolumePtr impulse = testing::MakeVolume(
      size, [](int i, int j, int k) { return i == 8 && j == 8 && k == 8 ? 27.0 : 0.0; });
  const VolumeEdit smooth{.shape = BoxShape{Vec3(0, 0, 0), Vec3(23, 23, 23)},
                          .operation = EditOperation::kSmooth};
  EXPECT_EQ(ApplyEdit(*impulse, smooth).changed_voxels, 27u);
  EXPECT_EQ(ApplyEdit(*impulse, smooth).changes.size(), 8u);
  const VolumePtr after = After(impulse, smooth);
  ForEachVoxel(Vec3i(3, 3, 3),
               [&](const Vec3i& p) { ASSERT_EQ(ValueAt(*after, p + Vec3i(7, 7, 7)), 1.0f); });
  const VolumePtr corner =
      testing::MakeVolume(size, [](int i, int j, int k) { return i + j + k == 0 ? 8.0 : 0.0; });
  EXPECT_EQ(ValueAt(*After(corner, smooth), Vec3i::Zero()), 1.0f);  // of eight voxels
}

TEST(EditTest, WhatChangesNothingMakesNoBricks) {
  const VolumePtr volume = testing::MakeVolume(Vec3i(20, 20, 20), [](int i, int, int) {
    return i < 10 ? 0.0 : i < 19 ? 0.1234567f : 1.0;
  });
  for (const VolumeEdit& edit :
       {VolumeEdit{.shape = BoxShape{Vec3(10, 0, 0), Vec3(18, 19, 19)}, .value = 0.1234567f},
        VolumeEdit{.shape = BoxShape{Vec3(0, 0, 0), Vec3(9, 19, 19)}, .value = -0.0},
        VolumeEdit{.shape = SphereShape{Vec3(5, 5, 5), 3.0}, .operation = EditOperation::kAdd},
        // The mean of equal values.
        VolumeEdit{.shape = BoxShape{Vec3(12, 0, 0), Vec3(17, 19, 19)},
        .operation = EditOperation::kSmooth},
        VolumeEdit{.shape = SphereShape{Vec3(4.5, 4.5, 4.5), 0.1}, .value = 0.1}}) {
    const EditResult result = ApplyEdit(*volume, edit);
    EXPECT_TRUE(result.changes.empty());
    EXPECT_FALSE(result.changed.has_value());
    EXPECT_EQ(result.changed_voxels, 0u);
  }
}

TEST(EditTest, ComparedBricksAreCountedAsTheEditWas) {
  const VolumePtr volume = RandomVolume(Vec3i(34, 29, 21), 7);
  RandomEdits edits(volume, 8);
  for (const EditOperation operation : kOperations) {
    const EditResult result = ApplyEdit(*volume, edits.Next(operation));
    const VolumePtr after = testing::WithChanges(*volume, result.changes);
    std::vector<BrickChange> back;
    for (const BrickChange& change : result.changes) {
      back.push_back({change.brick, volume->bricks().At(change.brick)});
    }
    const EditResult undo = CompareBricks(*after, back);
    EXPECT_EQ(undo.changed_voxels, result.changed_voxels);
    EXPECT_EQ(undo.changed->min, result.changed->min);
    EXPECT_EQ(undo.changed->max, result.changed->max);
    EXPECT_EQ(undo.changes.size(), result.changes.size());
    EXPECT_TRUE(CompareBricks(*volume, back).changes.empty());
  }
}

}  // namespace

// What an edit may not be.

namespace {

using testing::Refusal;

constexpr double kNotANumber = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

class EditRefusalTest : public ::testing::Test {
 protected:
  std::optional<ErrorKind> KindOf(const VolumeEdit& edit) const {
    return Refusal([&] { ApplyEdit(*volume_, edit); });
  }
  std::string TextOf(const VolumeEdit& edit) const {
    try {
      ApplyEdit(*volume_, edit);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }

  static std::shared_ptr<const VolumeSnapshot> Volume() {
    const auto plain = testing::MakeVolume(
        Vec3i(20, 18, 16), [](int i, int j, int k) { return i + j + k == 0 ? -5.0 : 10.0; });
    VolumeMetadata metadata = plain->metadata();
    metadata.unit = "HU";
    metadata.origin_W_mm = Vec3(100, 0, 0);
    return std::make_shared<VolumeSnapshot>(metadata, plain->bricks(), 1, 1);
  }

  // A good edit, to be spoilt.
  VolumeEdit good_{.shape = SphereShape{Vec3(5, 5, 5), 2.0}, .value = 1.0};
  const std::shared_ptr<const VolumeSnapshot> volume_ = Volume();
};

TEST_F(EditRefusalTest, NumbersThatAreNotFinite) {
  EXPECT_EQ(KindOf(good_), std::nullopt);
  for (const double bad : {kNotANumber, kInf, -kInf}) {
    std::vector<VolumeEdit> edits(5, good_);
    edits[0].value = bad;
    edits[1].strength = bad;
    edits[2].falloff = bad;
    edits[3].operation = EditOperation::kAdd;
    edits[3].value = bad;
    edits[4].operation = EditOperation::kSmooth;
    edits[4].value = bad;
    for (int a = 0; a < 3; ++a) {
      const Vec3 p = Vec3(5, 5, 5) + (Vec3::Unit(a).array() > 0).select(Vec3::Constant(bad), 0.0);
      for (const auto& shape : std::initializer_list<decltype(VolumeEdit::shape)>{
               SphereShape{p, 2.0}, BoxShape{p, Vec3(9, 9, 9)}, BoxShape{Vec3(1, 1, 1), p},
               CapsuleShape{p, Vec3(5, 5, 5), 2.0}, CapsuleShape{Vec3(5, 5, 5), p, 2.0},
               SphereShape{Vec3(5, 5, 5), bad}, CapsuleShape{Vec3(5, 5, 5), Vec3(6, 5, 5), bad}}) {
        edits.push_back(good_);
        edits.back().shape = shape;
      }
    }
    for (std::size_t n = 0; n < edits.size(); ++n) {
      EXPECT_EQ(KindOf(edits[n]), ErrorKind::kInvalidArgument) << bad << ", edit " << n;
    }
  }
}

TEST_F(EditRefusalTest, ShapesWithoutExtent) {
  for (const auto& shape : std::initializer_list<decltype(VolumeEdit::shape)>{
           SphereShape{Vec3(5, 5, 5), 0.0}, SphereShape{Vec3(5, 5, 5), -1.0},
           CapsuleShape{Vec3(5, 5, 5), Vec3(6, 6, 6), 0.0},
           CapsuleShape{Vec3(5, 5, 5), Vec3(6, 6, 6), -2.0},
           BoxShape{Vec3(5, 6, 5), Vec3(9, 5, 9)}}) {
    good_.shape = shape;
    EXPECT_EQ(KindOf(good_), ErrorKind::kInvalidArgument);
  }
  good_.shape = BoxShape{Vec3(5, 5, 5), Vec3(5, 5, 5)};  // one voxel
  EXPECT_EQ(ApplyEdit(*volume_, good_).changed_voxels, 1u);
}

TEST_F(EditRefusalTest, FalloffAndStrengthOutOfTheirRange) {
  for (const double bad : {-1e-9, -1.0}) {
    VolumeEdit edit = good_;
    edit.falloff = bad;
    EXPECT_EQ(KindOf(edit), ErrorKind::kInvalidArgument);
  }
  for (const double bad : {0.0, -0.5, 1.0000001}) {
    VolumeEdit edit = good_;
    edit.operation = EditOperation::kPaint;
    edit.strength = bad;
    EXPECT_EQ(KindOf(edit), ErrorKind::kInvalidArgument);
  }
}

TEST_F(EditRefusalTest, ValuesOutOfTheRangeNameItAndTheUnit) {
  for (const EditOperation operation : {EditOperation::kSet, EditOperation::kPaint}) {
    for (const double bad : {-5.001, 10.001, 1e300}) {
      good_.operation = operation;
      good_.value = bad;
      EXPECT_EQ(KindOf(good_), ErrorKind::kInvalidArgument);
      EXPECT_NE(TextOf(good_).find("-5 to 10 HU"), std::string::npos);
    }
    for (const double edge : {-5.0, 10.0}) {
      good_.value = edge;
      EXPECT_EQ(KindOf(good_), std::nullopt);
    }
  }
  good_.operation = EditOperation::kAdd;
  good_.value = 1e300;
  EXPECT_EQ(KindOf(good_), std::nullopt);
}

TEST_F(EditRefusalTest, RegionsThatMissTheVolume) {
  for (int a = 0; a < 3; ++a) {
    for (const double sign : {-1.0, 1.0}) {
      const double outside = sign < 0 ? -4.6 : volume_->size()[a] - 1 + 4.6;
      for (const double reach : {4.0, 4.2}) {
        Vec3 p(5, 5, 5);
        p[a] = outside;
        good_.shape = SphereShape{p, reach - 1.0};
        good_.falloff = 1.0;
        const bool misses = reach < 4.1;
        EXPECT_EQ(KindOf(good_) == ErrorKind::kInvalidArgument, misses) << a << sign << reach;
        good_.shape = CapsuleShape{p, p, reach - 1.0};
        EXPECT_EQ(KindOf(good_) == ErrorKind::kInvalidArgument, misses);
        good_.shape = BoxShape{p - Vec3::Constant(reach - 1.0), p + Vec3::Constant(reach - 1.0)};
        EXPECT_EQ(KindOf(good_) == ErrorKind::kInvalidArgument, misses);
      }
    }
  }
  // Within in one frame, not in the other.
  good_.falloff = 0.0;
  good_.shape = SphereShape{Vec3(5, 5, 5), 2.0};
  good_.frame = EditFrame::kWorld;
  EXPECT_EQ(KindOf(good_), ErrorKind::kInvalidArgument);
  good_.shape = SphereShape{Vec3(105, 5, 5), 2.0};
  EXPECT_EQ(KindOf(good_), std::nullopt);
}

TEST_F(EditRefusalTest, LengthsBeyondAllMeasureNeitherOverflowNorHang) {
  const std::uint64_t all = 20 * 18 * 16;
  for (const auto& shape : std::initializer_list<decltype(VolumeEdit::shape)>{
           SphereShape{Vec3(5, 5, 5), 1e300},
           BoxShape{Vec3::Constant(-1e308), Vec3::Constant(1e308)},
           CapsuleShape{Vec3(5, 5, 5), Vec3(1e29, 5, 5), 1e300},
           CapsuleShape{Vec3(-1e30, 5, 5), Vec3(1e30, 5, 5), 1e31}}) {
    good_.shape = shape;
    EXPECT_EQ(ApplyEdit(*volume_, good_).changed_voxels, all);
  }
  good_.shape = SphereShape{Vec3(5, 5, 5), 1.0};
  good_.falloff = 1e300;
  EXPECT_EQ(ApplyEdit(*volume_, good_).changed_voxels, all);
  for (const double far : {1e31, 1e300, -1e308}) {
    good_.shape = SphereShape{Vec3(far, 5, 5), 2.0};
    EXPECT_EQ(KindOf(good_), ErrorKind::kInvalidArgument);
    good_.shape = CapsuleShape{Vec3(5, 5, 5), Vec3(5, far, 5), 2.0};
    EXPECT_EQ(KindOf(good_), ErrorKind::kInvalidArgument);
  }
}

TEST_F(EditRefusalTest, BlocksThatDoNotFit) {
  using Vec3l = Eigen::Matrix<std::int64_t, 3, 1>;
  const auto block = [](const Vec3l& min, const Vec3l& size, std::size_t values) {
    return VolumeEdit{.shape = DenseBlock{min, size, std::vector<float>(values, 1.0f)}};
  };
  EXPECT_EQ(KindOf(block({18, 16, 14}, {2, 2, 2}, 8)), std::nullopt);
  const std::int64_t huge = 4294967295;
  VolumeEdit smooth = block({0, 0, 0}, {2, 2, 2}, 8), soft = smooth, world = smooth;
  smooth.operation = EditOperation::kSmooth;
  soft.falloff = 1.0;
  world.frame = EditFrame::kWorld;
  for (const VolumeEdit& bad :
       {block({19, 16, 14}, {2, 2, 2}, 8), block({18, 17, 14}, {2, 2, 2}, 8),
        block({18, 16, 15}, {2, 2, 2}, 8), block({20, 0, 0}, {1, 1, 1}, 1),
        block({0, 0, 0}, {0, 2, 2}, 0), block({0, 0, 0}, {2, 2, 2}, 7),
        block({0, 0, 0}, {2, 2, 2}, 9), block({huge, huge, huge}, {1, 1, 1}, 1),
        block({0, 0, 0}, {huge, huge, huge}, 1), block({1, 0, 0}, {huge, 1, 1}, 1),
        block({-1, 0, 0}, {2, 2, 2}, 8), smooth, soft, world}) {
    EXPECT_EQ(KindOf(bad), ErrorKind::kInvalidArgument);
  }
  for (const float bad : {NAN, HUGE_VALF, -6.0f, 11.0f}) {
    for (const EditOperation operation :
         {EditOperation::kSet, EditOperation::kPaint, EditOperation::kAdd}) {
      VolumeEdit edit = block({0, 0, 0}, {2, 2, 2}, 8);
      std::get<DenseBlock>(edit.shape).values[5] = bad;
      edit.operation = operation;
      const bool refused = operation != EditOperation::kAdd || !std::isfinite(bad);
      EXPECT_EQ(KindOf(edit) == ErrorKind::kInvalidArgument, refused) << bad;
    }
  }
}

// A volume without its darkest values can still be carved down to them.
TEST(EditRangeTest, WholeNumbersHaveTheRangeOfTheirType) {
  const auto plain = testing::MakeVolume(
      Vec3i(8, 8, 8), [](int i, int j, int k) { return i + j + k == 0 ? 48.0 : 207.0; });
  const auto refusal = [&](const char* type, double value, double least = 48.0) {
    VolumeMetadata metadata = plain->metadata();
    metadata.original_type = type;
    metadata.value_min = least;
    const VolumeSnapshot volume(metadata, plain->bricks(), 1, 1);
    const VolumeEdit edit{.shape = SphereShape{Vec3(4, 4, 4), 2.0}, .value = value};
    return Refusal([&] {
      const EditResult result = ApplyEdit(volume, edit);
      EXPECT_EQ((*result.changes.front().values)[VoxelInBrick(4, 4, 4)], value);
    });
  };
  EXPECT_EQ(refusal("uint8", 0.0), std::nullopt);
  EXPECT_EQ(refusal("uint8", 255.0), std::nullopt);
  EXPECT_EQ(refusal("uint8", -1.0), ErrorKind::kInvalidArgument);
  EXPECT_EQ(refusal("uint8", 256.0), ErrorKind::kInvalidArgument);
  EXPECT_EQ(refusal("int16", -32768.0), std::nullopt);
  EXPECT_EQ(refusal("float32", 47.0), ErrorKind::kInvalidArgument);
  EXPECT_EQ(refusal("uint8", 0.0, 47.5), ErrorKind::kInvalidArgument);  // a scaled file
}

// Bricks are shared, so that so many voxels cost little.
TEST(EditLimitTest, MoreVoxelsThanAtOnceAreTooMany) {
  const LeafPtr zero = Leaf::Constant(LeafType::kFloat, 0.0f);
  const auto made =
      testing::VolumeOfLeaves(Vec3i(257, 256, 256), [&](const Vec3i&) { return zero; });
  const VolumeSnapshot& volume = *made;
  VolumeEdit edit{.shape = BoxShape{Vec3(0, 0, 0), Vec3(256, 255, 255)}, .value = 1.0};
  EXPECT_EQ(Refusal([&] { ApplyEdit(volume, edit); }), ErrorKind::kTooLarge);
  edit.shape = SphereShape{Vec3(99, 99, 99), 1e300};
  EXPECT_EQ(Refusal([&] { ApplyEdit(volume, edit); }), ErrorKind::kTooLarge);
  // With progress, there is no limit; an exception ends it.
  EXPECT_EQ(Refusal([&] {
              ApplyEdit(volume, edit, {.progress = [](double share) {
                          if (share > 0.1) throw Error(ErrorKind::kCancelled, "enough");
                        }});
            }),
            ErrorKind::kCancelled);
  edit.shape = DenseBlock{{0, 0, 0}, {257, 256, 256}, {}};
  EXPECT_EQ(Refusal([&] { ApplyEdit(volume, edit); }), ErrorKind::kTooLarge);
  // What the lattice cuts off does not count.
  edit.shape = BoxShape{Vec3(1, -1e9, -1e9), Vec3(1e300, 1e9, 1e9)};
  EXPECT_EQ(ApplyEdit(volume, edit).changed_voxels, 1u << 24);
}

}  // namespace

}  // namespace palpate
