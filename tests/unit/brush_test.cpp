// A stroke of the brush acts once on each voxel, in every type of values.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <map>
#include <random>
#include <utility>

#include "server/session/edits/volume_editor.h"
#include "tests/support/made_volume.h"
#include "tests/support/running_session.h"

namespace palpate {
namespace {

// Calls visit(a, b) with the values of each voxel of two volumes of 40³ voxels.
template <class Visit>
void ForEachPair(const VolumeSnapshot& a, const VolumeSnapshot& b, const Visit& visit) {
  for (int n = 0; n < 64'000; ++n) {
    const Vec3i p(n / 1600, n / 40 % 40, n % 40);
    visit(testing::ValueAt(a, p), testing::ValueAt(b, p));
  }
}

class BrushTest : public ::testing::TestWithParam<LeafType>, protected testing::RunningSession {
 protected:
  // Values of the whole range of the type, or from 0 to 1.
  void SetUp() override {
    const std::map<LeafType, std::pair<double, double>> ranges = {
        {LeafType::kFloat, {0.0, 1.0}},
        {LeafType::kUint8, {0, 255}},
        {LeafType::kInt16, {-32768, 32767}},
        {LeafType::kUint16, {0, 65535}}};
    const auto [min, max] = ranges.at(GetParam());
    range_ = max - min;
    const auto leaf = [&, min = min](const Vec3i& brick) {
      Brick values;
      for (int n = 0; n < kBrickVoxels; ++n) {
        const Vec3i p = 8 * brick + Vec3i(n / 64, n / 8 % 8, n % 8);
        const double share =
            (p - Vec3i(20, 20, 20)).cast<double>().norm() < 9.0 ? 1.0 : 0.01 * p.z();
        const double value = min + range_ * share;
        values[static_cast<std::size_t>(n)] =
            static_cast<float>(GetParam() == LeafType::kFloat ? value : std::round(value));
      }
      return Leaf::Of(GetParam(), values);
    };
    VolumeMetadata metadata;
    metadata.size = {40, 40, 40};
    metadata.source = "made";
    metadata.value_min = min;
    metadata.value_max = max;
    session().PublishVolume({.source = {}, .discards_edits = true}, metadata,
                            testing::VolumeOfLeaves(metadata.size, leaf, min, max)->bricks());
    ASSERT_EQ(volume()->bricks().At({2, 2, 2})->type(), GetParam());
  }

  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  Vec3 RandomPoint() { return {Uniform(0, 39), Uniform(0, 39), Uniform(0, 39)}; }

  double range_ = 1.0;
  std::mt19937 random_{17};
  VolumeEditor editor_{session()};
};

INSTANTIATE_TEST_SUITE_P(Types, BrushTest,
                         ::testing::Values(LeafType::kFloat, LeafType::kUint8, LeafType::kInt16,
                                           LeafType::kUint16));

// Short capsules along a straight way, back and forth, equal one capsule.
TEST_P(BrushTest, AStrokeActsOnceOnEachVoxel) {
  const ContentHash loaded = hash();
  int strokes = 0;
  for (int n = 0; n < 50; ++n) {
    VolumeEdit edit;
    edit.operation = static_cast<EditOperation>(1 + n % 5);
    edit.value = Uniform(0.1, 0.9) * volume()->metadata().value_max;
    edit.falloff = Uniform(0, 4);
    edit.strength = edit.operation == EditOperation::kSet ? 1.0 : 0.3;
    const Vec3 from = RandomPoint(), to = RandomPoint();
    const double radius = Uniform(1, 6);
    const Stroke stroke{.number = static_cast<std::uint64_t>(n + 1), .acts_once = true};
    const auto draw = [&](int step, int next) {
      edit.shape =
          CapsuleShape{from + step / 8.0 * (to - from), from + next / 8.0 * (to - from), radius};
      editor_.Edit(edit, {}, stroke);
    };
    for (int step = 0; step < 8; ++step) draw(step, step + 1);
    const auto there = volume();
    for (int step = 8; step > 0; --step) draw(step, step - 1);
    EXPECT_EQ(volume(), there);      // nothing changed on the way back
    if (hash() == loaded) continue;  // it had nothing to change
    ++strokes;
    EXPECT_EQ(session().volume().unsaved_edits, 1u);

    editor_.Undo();
    EXPECT_EQ(hash(), loaded);
    edit.shape = CapsuleShape{from, to, radius};
    editor_.Edit(edit, {}, {.number = 1000, .acts_once = true});
    const VolumeMetadata& range = volume()->metadata();
    ForEachPair(*volume(), *there, [&](float once, float drawn) {
      ASSERT_NEAR(once, drawn, 1e-5 * range_);
      ASSERT_TRUE(drawn >= range.value_min && drawn <= range.value_max);
    });
    editor_.Undo();
  }
  EXPECT_GT(strokes, 40);
}

}  // namespace
}  // namespace palpate
