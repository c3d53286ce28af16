// What an edit may not be.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "server/volume/edit/edit.h"
#include "tests/support/made_volume.h"
#include "tests/support/refusal.h"

namespace palpate {
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
