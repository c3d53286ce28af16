// Typed bricks and their sparse map, against plain arrays; and bricks through zstd.
#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "common/bricks/brick_map.h"
#include "common/bricks/zstd_codec.h"
#include "common/error/error.h"
#include "tests/support/refusal.h"

namespace palpate {

namespace {

template <class T>
void ExpectHeld(std::vector<T> values) {
  values.resize(kBrickVoxels, values.back());
  const auto brick = TypedBrick::Of(std::span<const T, kBrickVoxels>(values));
  EXPECT_EQ(brick->type(), kLeafTypeOf<T>);
  EXPECT_FALSE(brick->is_constant());
  const Brick floats = brick->Floats();
  for (std::size_t n = 0; n < kBrickVoxels; ++n) {
    ASSERT_EQ(brick->template values<T>()[n], values[n]);
    ASSERT_EQ((*brick)[n], static_cast<float>(values[n]));
    ASSERT_EQ(floats[n], static_cast<float>(values[n]));
  }
  const auto constant = TypedBrick::Constant(kLeafTypeOf<T>, static_cast<float>(values[0]));
  EXPECT_EQ(constant->type(), kLeafTypeOf<T>);
  EXPECT_TRUE(constant->is_constant());
  EXPECT_EQ(constant->template values<T>()[0], values[0]);
  for (const float value : constant->Floats()) ASSERT_EQ(value, static_cast<float>(values[0]));
  EXPECT_EQ((*constant)[511], static_cast<float>(values[0]));
}

TEST(TypedBrick, HoldsEachType) {
  ExpectHeld<std::uint8_t>({0, 255, 7});
  ExpectHeld<std::int16_t>({-32768, 32767, 0});
  ExpectHeld<std::uint16_t>({65535, 0, 1});
  ExpectHeld<float>({-0.1f, 1e30f, 1e-40f});
}

TypedBrickPtr Made(int value) {
  return TypedBrick::Constant(LeafType::kFloat, static_cast<float>(value));
}

TEST(BrickRuns, AddAndJoin) {
  std::vector<BrickRun> runs;
  AddTo(runs, {4, 2});
  AddTo(runs, {6, 1});
  AddTo(runs, {1, 2});
  AddTo(runs, {2, 1});
  EXPECT_EQ(runs, (std::vector<BrickRun>{{4, 3}, {1, 2}, {2, 1}}));
  AddTo(runs, {3, 1});
  Join(runs);
  EXPECT_EQ(runs, (std::vector<BrickRun>{{1, 6}}));
}

void ExpectEqual(const BrickMap& map, const std::vector<TypedBrickPtr>& expected) {
  for (std::uint64_t n = 0; n < expected.size(); ++n) ASSERT_EQ(map.At(n), expected[n]) << n;
}

// Random changes of a map and of a copy of it; states that were shared stay.
TEST(BrickMap, EqualsAnArrayAndSharedStatesStay) {
  std::mt19937 random(11);
  const Vec3i count(9, 10, 21);
  const TypedBrickPtr background = Made(0);
  BrickMap map(count, background), copy(count, background);
  const std::uint64_t size = map.size();
  ASSERT_EQ(size, 9u * 10u * 21u);
  std::vector<TypedBrickPtr> expected(size, background);
  std::vector<std::pair<std::shared_ptr<const BrickMap>, std::vector<TypedBrickPtr>>> shared;
  std::vector<TypedBrickPtr> made{background};
  for (int n = 1; n < 4; ++n) made.push_back(Made(n));
  for (int n = 0; n < 2000; ++n) {
    BrickRun run{random() % size, 1};
    if (random() % 4 == 0) run.count = 1 + random() % (size - run.first);
    const TypedBrickPtr brick = random() % 3 == 0 ? Made(n) : made[random() % made.size()];
    map.Fill(run, brick);
    std::fill_n(expected.begin() + static_cast<std::ptrdiff_t>(run.first), run.count, brick);
    copy.CopyFrom(map, run);
    if (random() % 100 == 0) shared.emplace_back(map.Share(), expected);
    if (random() % 100 == 0) shared.emplace_back(copy.Share(), expected);
  }
  ExpectEqual(map, expected);
  ExpectEqual(copy, expected);
  ASSERT_GT(shared.size(), 10u);
  for (const auto& [state, then] : shared) ExpectEqual(*state, then);
}

TEST(BrickMap, ABlockOfOneBrickIsSaidToBe) {
  BrickMap map(Vec3i(16, 8, 20), Made(0));
  EXPECT_EQ(map.block_count(), Vec3i(2, 1, 3));
  const TypedBrickPtr other = Made(1);
  map.Put(20 * 8 * 3 + 1, other);
  EXPECT_FALSE(map.Only(Vec3i(0, 0, 0)));
  EXPECT_TRUE(map.Only(Vec3i(0, 0, 1)));
  map.Fill({0, 20 * 8 * 8}, other);
  EXPECT_EQ(map.Only(Vec3i(0, 0, 0)), other);
  EXPECT_EQ(map.Only(Vec3i(0, 0, 1)), other);
  EXPECT_FALSE(map.Only(Vec3i(0, 0, 2))) << "places beyond the lattice are not filled";
  EXPECT_EQ((*map.Only(Vec3i(1, 0, 0)))[0], 0.0f);
  EXPECT_EQ(map.Value(63, 63, 159), 1.0f);
  EXPECT_EQ(map.Value(64, 0, 0), 0.0f);
}

}  // namespace

namespace {

using testing::Refusal;

TEST(ZstdCodec, RoundTripsAnyBits) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  for (const std::vector<float>& values :
       {std::vector<float>{}, {0.0f}, {-0.0f, nan, -infinity, 1e-42f}, std::vector<float>(99999)}) {
    const std::string bytes = Compress(std::span<const float>(values));
    ASSERT_EQ(CountValues(bytes, sizeof(float), values.size()), values.size());
    std::vector<float> back(values.size(), 7.0f);
    Decompress(bytes, std::span(back));
    if (values.empty()) continue;
    EXPECT_EQ(std::memcmp(back.data(), values.data(), values.size() * sizeof(float)), 0);
    EXPECT_EQ(Refusal([&] { CountValues(bytes, sizeof(float), values.size() - 1); }),
              ErrorKind::kInvalidArgument);
    back.resize(values.size() - 1);
    EXPECT_EQ(Refusal([&] { Decompress(bytes, std::span(back)); }), ErrorKind::kInvalidArgument);
    back.resize(values.size() + 1);
    EXPECT_EQ(Refusal([&] { Decompress(bytes, std::span(back)); }), ErrorKind::kInvalidArgument);
    EXPECT_EQ(Refusal([&] { Decompress(bytes.substr(0, bytes.size() / 2), std::span(back)); }),
              ErrorKind::kInvalidArgument);
  }
  EXPECT_EQ(Refusal([&] { CountValues("", sizeof(float), 8); }), ErrorKind::kInvalidArgument);
}

}  // namespace

}  // namespace palpate
