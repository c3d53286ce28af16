// The bricks on the graphics card: pictures want them, edits change them, and memory bounds them.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "common/error/error.h"
#include "tests/support/surface_rig.h"

namespace palpate::view {
namespace {

using testing::CastRig;
using testing::Look;
using testing::MakeVoxels;
using testing::Picture;
using testing::Scene;
using testing::VoxelArray;

constexpr ImageSize kCastSize{120, 90};

// No multiple of a brick along any axis.
VoxelArray CastWaves() {
  return MakeVoxels({30, 25, 33}, [](int i, int j, int k) {
    return static_cast<float>(std::sin(0.4 * i) + std::sin(0.5 * j) * std::cos(0.3 * k));
  });
}

// Whole numbers from 0 to 200; the surface at 100.5 is round and rough.
VoxelArray Whole(const Vec3i& size) {
  return MakeVoxels(size, [&](int i, int j, int k) {
    const Vec3 middle = 0.5 * size.cast<double>();
    const double away = (Vec3(i, j, k) - middle).norm() / middle.minCoeff();
    const double rough = std::sin(0.9 * i) * std::sin(0.8 * j) * std::sin(0.7 * k);
    return static_cast<float>(
        std::round(std::clamp(260.0 - 210.0 * away + 9.0 * rough, 0.0, 200.0)));
  });
}

CastRequest RequestFor(const VoxelArray& voxels, double isovalue = 0.3) {
  const Vec3 middle = (0.5 * voxels.size.cast<double>()).array().floor();
  const Look look{middle + 1.6 * voxels.size.maxCoeff() * Vec3(0.6, 0.5, 0.7), middle};
  CastRequest request = testing::RequestFor(look, {}, voxels.size, kCastSize);
  request.surface.isovalue = isovalue;
  return request;
}

CastRequest VeiledRequestFor(const VoxelArray& voxels) {
  CastRequest request = RequestFor(voxels);
  request.surface.veil.shown = true;
  request.surface.veil.isovalue = -0.5;
  return request;
}

// With all its bricks.
Picture PictureOf(const VoxelArray& voxels, const CastRequest& request) {
  return CastRig(voxels).Cast(request);
}

// The memory of so many slots of floats, beside that of the tables of a small volume.
std::size_t BudgetOf(std::size_t slots) {
  CastRig rig(CastWaves());
  const std::size_t tables =
      rig.cache.bytes() - rig.cache.atlas().capacity() * BrickAtlas::SlotBytes(LeafType::kFloat);
  return tables + slots * BrickAtlas::SlotBytes(LeafType::kFloat);
}

class BricksOnTheCard : public testing::SurfaceRig {};

TEST_F(BricksOnTheCard, EachTypeGivesThePictureOfFloats) {
  const VoxelArray voxels = Whole({40, 33, 50});
  CastRequest request = RequestFor(voxels, 100.5);
  request.surface.veil = {.shown = true, .isovalue = 40.0};
  request.surface.planes[0] = {true, Vec3(1.0, 0.3, 0.0).normalized(), 26.0};
  request.surface.window_max = 200.0;
  const Picture floats = PictureOf(voxels, request);
  for (const LeafType type : {LeafType::kUint8, LeafType::kInt16, LeafType::kUint16}) {
    CastRig rig(voxels, {}, type);
    EXPECT_EQ(rig.Cast(request), floats) << Name(type);
    EXPECT_EQ(rig.cache.atlas().type(), type);
  }
  Scene scene{voxels};
  scene.options.isovalue = 100.5;
  ExpectSame("whole numbers", scene, testing::LooksAt(voxels.size));
}

// Values below 0, and beyond those of int16.
TEST_F(BricksOnTheCard, EachTypeHoldsTheEndsOfItsRange) {
  for (const auto& [type, factor, offset] :
       {std::tuple(LeafType::kInt16, 327.67f, -32768.0f), {LeafType::kUint16, 327.675f, 0.0f}}) {
    VoxelArray voxels = Whole({30, 30, 30});
    for (float& value : voxels.values) value = std::round(offset + factor * value);
    voxels.background = offset;
    const CastRequest request = RequestFor(voxels, offset + 100.5 * factor);
    EXPECT_EQ(CastRig(voxels, {}, type).Cast(request), PictureOf(voxels, request));
  }
}

TEST_F(BricksOnTheCard, AFloatAmongIntegersIsDrawnExactly) {
  VoxelArray voxels = Whole({40, 33, 50});
  const CastRequest request = RequestFor(voxels, 100.5);
  CastRig rig(voxels, {}, LeafType::kInt16);
  rig.Cast(request);
  // Fractions, with the same surface through the same bricks.
  for (float& value : voxels.values) value = 100.5f + 1.5f * (value - 100.5f);
  std::vector<Vec3i> bricks;
  for (int n = 0; n < 5 * 5 * 7; ++n) bricks.push_back({n / 35, n / 7 % 5, n % 7});
  rig.volume.Take(testing::Edit(rig.volume, voxels, bricks, LeafType::kInt16));
  // Bricks that were there stay: the next picture is whole at once.
  EXPECT_TRUE(rig.cache.TakeUp(rig.volume, SIZE_MAX));
  EXPECT_EQ(rig.cache.atlas().type(), LeafType::kFloat);
  EXPECT_EQ(rig.CastOnce(request), PictureOf(voxels, request));
  EXPECT_EQ(rig.Cast(request), PictureOf(voxels, request));
  // From the start, too, and where the background is what the type does not hold.
  EXPECT_EQ(CastRig(voxels, {}, LeafType::kInt16).Cast(request), PictureOf(voxels, request));
  voxels.background = -0.5f;
  EXPECT_EQ(CastRig(voxels, {}, LeafType::kInt16).Cast(request), PictureOf(voxels, request));
}

// Blocks of 64 voxels with one value, beside bricks that vary.
TEST_F(BricksOnTheCard, ABallLargerThanABlockIsExactFromOutsideAndWithin) {
  Scene scene{MakeVoxels({150, 140, 160}, [](int i, int j, int k) {
    const double away = (Vec3(i, j, k) - Vec3(74.3, 70.2, 79.6)).norm();
    return static_cast<float>(std::clamp(66.0 - away, -3.0, 3.0));
  })};
  ExpectSame("ball", scene, testing::LooksAt(scene.voxels.size));
  const std::vector<Look> inside{{Vec3(74.0, 70.0, 79.0), Vec3(150.0, 90.0, 60.0)},
                                 {Vec3(63.0, 63.0, 127.0), Vec3(63.0, 63.0, 0.0)}};
  ExpectSame("from within", scene, inside);
}

// Every picture on the way is that of a volume of the values that the card shows: near enough that
// no surface has a hole.
TEST_F(BricksOnTheCard, PicturesOnTheWayAreWholeAndBecomeExact) {
  const VoxelArray ball = MakeVoxels({70, 65, 73}, [](int i, int j, int k) {
    return static_cast<float>(28.0 - (Vec3(i, j, k) - Vec3(34.0, 32.0, 36.0)).norm());
  });
  const CastRequest request = RequestFor(ball, 0.0);
  const Picture exact = PictureOf(ball, request);
  CastRig rig(ball);
  std::size_t last = SIZE_MAX;
  for (bool done = false; !done;) {
    const Picture seen = rig.CastOnce(request);
    std::size_t differ = 0;
    for (std::size_t n = 0; n < seen.pixels(); ++n) {
      differ += seen.depth[n] != exact.depth[n] ? 1 : 0;
      if (!exact.Shows(n) || !seen.Shows(n)) continue;
      const Vec3 a = testing::PointOf(request, {}, n, seen.depth[n]);
      // A chord of 8 voxels under an arc of radius 28.
      ASSERT_NEAR((a - Vec3(34.0, 32.0, 36.0)).norm(), 28.0, 1.0) << n;
    }
    EXPECT_LE(differ, last);
    last = differ;
    const std::uint64_t before = rig.cache.version();
    rig.cache.TakeUp(rig.volume, 9);
    done = rig.cache.version() == before;
  }
  EXPECT_EQ(rig.CastOnce(request), exact);
  EXPECT_EQ(last, 0u);
}

// Random edits, and pictures while their bricks come.
TEST_F(BricksOnTheCard, FollowsEditsOfBricksThatItShows) {
  std::mt19937 random(5);
  VoxelArray voxels = CastWaves();
  const CastRequest request = VeiledRequestFor(voxels);
  CastRig rig(voxels);
  rig.Cast(request);
  for (int round = 0; round < 12; ++round) {
    std::vector<Vec3i> bricks;
    for (int n = 0; n < 1 + round % 4; ++n) {
      const Vec3i brick(static_cast<int>(random() % 4), static_cast<int>(random() % 4),
                        static_cast<int>(random() % 5));
      if (std::find(bricks.begin(), bricks.end(), brick) != bricks.end()) continue;
      bricks.push_back(brick);
      const float shift = static_cast<float>(random() % 100) / 50.0f - 1.0f;
      for (int v = 0; v < kBrickVoxels; ++v) {
        const Vec3i at = 8 * brick + Vec3i(v >> 6, v >> 3 & 7, v & 7);
        if ((at.array() >= voxels.size.array()).any()) continue;
        const auto place =
            (static_cast<std::size_t>(at.x()) * voxels.size.y() + at.y()) * voxels.size.z() +
            at.z();
        voxels.values[place] = round % 5 == 4 ? shift : voxels.values[place] + shift;
      }
    }
    rig.volume.Take(testing::Edit(rig.volume, voxels, bricks));
    rig.cache.TakeUp(rig.volume, round % 3 == 0 ? 3 : SIZE_MAX);
    rig.CastOnce(request);
    VoxelArray same = voxels;
    same.background = CastWaves().background;
    client::VolumeUpdate whole = testing::WholeVolume(same, {});
    whole.lattice = rig.volume.lattice();
    CastRig fresh(CastWaves());
    fresh.volume.Take(whole);
    EXPECT_EQ(rig.Cast(request), fresh.Cast(request)) << round;
  }
}

TEST_F(BricksOnTheCard, AnEditUploadsItsBricksAlone) {
  VoxelArray voxels = Whole({128, 128, 128});
  const CastRequest request = RequestFor(voxels, 100.5);
  CastRig rig(voxels, {}, LeafType::kUint8);
  rig.Cast(request);
  const std::uint64_t shown = rig.cache.uploaded_bricks();
  EXPECT_GT(shown, 200u);
  EXPECT_LT(shown, 17u * 17 * 17 / 2) << "only what is visible";
  // A brick that the surface passes, and the eye sees.
  const Picture before = rig.Cast(request);
  const auto middle = static_cast<std::size_t>(45 * kCastSize.width + 60);
  ASSERT_TRUE(before.Shows(middle));
  const Vec3i seen =
      testing::PointOf(request, {}, middle, before.depth[middle]).cast<int>() / kBrickEdge;
  for (int n = 0; n < kBrickVoxels; ++n) {
    const Vec3i at = 8 * seen + Vec3i(n >> 6, n >> 3 & 7, n & 7);
    float& value = voxels.values[(static_cast<std::size_t>(at.x()) * 128 + at.y()) * 128 + at.z()];
    value = std::min(200.0f, value + 3.0f);
  }
  rig.volume.Take(testing::Edit(rig.volume, voxels, {seen}, LeafType::kUint8));
  rig.cache.TakeUp(rig.volume, SIZE_MAX);
  EXPECT_GT(rig.cache.uploaded_bricks(), shown);
  EXPECT_LE(rig.cache.uploaded_bricks(), shown + 8);
  EXPECT_EQ(rig.Cast(request), PictureOf(voxels, request));
  // A brick that nobody sees.
  const std::uint64_t now = rig.cache.uploaded_bricks();
  rig.volume.Take(testing::Edit(rig.volume, Whole({128, 128, 128}), {Vec3i(8, 8, 8)}));
  rig.Cast(request);
  EXPECT_EQ(rig.cache.uploaded_bricks(), now);
}

// A volume that replaces another leaves nothing of it, though its bricks be few.
TEST_F(BricksOnTheCard, AnotherVolumeBeginsAnew) {
  CastRig rig(CastWaves());
  rig.Cast(VeiledRequestFor(CastWaves()));
  const VoxelArray ball = MakeVoxels({20, 20, 20}, [](int i, int j, int k) {
    return static_cast<float>(std::max(0.0, 5.0 - (Vec3(i, j, k) - Vec3(9.0, 9.0, 9.0)).norm()));
  });
  const CastRequest request = VeiledRequestFor(ball);
  rig.volume.Take(testing::WholeVolume(ball, {}));
  EXPECT_TRUE(rig.cache.TakeUp(rig.volume, 1)) << "no picture of it was drawn yet";
  EXPECT_EQ(rig.Cast(request), CastRig(ball).Cast(request));

  client::VolumeUpdate none;
  none.all = true;
  rig.volume.Take(none);
  EXPECT_TRUE(rig.cache.TakeUp(rig.volume, SIZE_MAX));
  EXPECT_FALSE(rig.cache.has_volume());
  const Picture nothing = rig.Cast(request);
  for (std::size_t n = 0; n < nothing.pixels(); ++n) ASSERT_FALSE(nothing.Shows(n));
}

// By rows, few bricks at a time, with an edit on the way: the shown picture stays until the next
// one is whole, and that is the exact one.
TEST_F(BricksOnTheCard, ACastInPartsGivesTheSamePicture) {
  const auto made = [](bool dented) {
    return MakeVoxels({70, 65, 73}, [dented](int i, int j, int k) {
      if (dented && i == 60 && j == 32 && k == 36) return -20.0f;
      return static_cast<float>(28.0 - (Vec3(i, j, k) - Vec3(34.0, 32.0, 36.0)).norm());
    });
  };
  const VoxelArray ball = made(false);
  const VoxelArray edited = made(true);
  const CastRequest request = VeiledRequestFor(ball);
  CastRequest coarse = request;
  coarse.size = {30, 22};
  for (const int rows : {1, 7, kCastSize.height, 1000}) {
    CastRig rig(ball);
    const Picture before = rig.CastOnce(coarse);
    int parts = 0;
    bool whole = false;
    while (!whole && parts < 100'000) {
      EXPECT_EQ(rig.CastOnce(coarse).size, before.size);
      whole = rig.caster.CastRows(rig.cache, request, rows) == SurfaceCaster::Progress::kWhole;
      rig.cache.TakeUp(rig.volume, 3);
      if (++parts == 2) {
        rig.volume.Take(testing::Edit(rig.volume, edited, {Vec3i(7, 4, 4)}));
      }
    }
    ASSERT_TRUE(whole) << rows;
    EXPECT_GE(parts, kCastSize.height / rows);
    EXPECT_FALSE(rig.caster.Cast(rig.cache, request)) << "it is the shown one";
    EXPECT_EQ(rig.caster.CastRows(rig.cache, request, 1), SurfaceCaster::Progress::kWhole);
    EXPECT_EQ(rig.CastOnce(request), CastRig(edited).Cast(request)) << rows;
  }
}

TEST_F(BricksOnTheCard, AVolumeIsNotShownBeforeItHasAPlace) {
  const VoxelArray voxels = CastWaves();
  client::VolumeUpdate update = testing::WholeVolume(voxels, {});
  update.placement.reset();
  CastRig rig(voxels);
  rig.volume.Take(update);
  rig.cache.TakeUp(rig.volume, SIZE_MAX);
  const Picture nothing = rig.Cast(RequestFor(voxels));
  EXPECT_EQ(nothing.depth, std::vector<float>(nothing.pixels(), 1.0f));
  EXPECT_EQ(rig.caster.casts(), 1u);
}

// While means stand in, they are shown coarsely, and nothing is uploaded in their place.
TEST_F(BricksOnTheCard, MeansStandInCoarselyUntilBricksCome) {
  const VoxelArray voxels = Whole({64, 64, 64});
  client::VolumeUpdate whole = testing::WholeVolume(voxels, {}, LeafType::kUint8);
  client::VolumeUpdate first = whole;
  first.bricks =
      BrickMap(whole.lattice->BrickCounts(), TypedBrick::Constant(LeafType::kUint8, 0.0f)).Share();
  first.changed.clear();
  first.complete.reset();
  first.bricks_left = 512;
  first.overview_size = Vec3i::Constant(16);
  for (int n = 0; n < 4096; ++n) {
    const Vec3i at = 4 * Vec3i(n >> 8, n >> 4 & 15, n & 15);
    first.overview.push_back(voxels.At(at.x() + 2, at.y() + 2, at.z() + 2) + 0.3f);
  }
  const CastRequest request = RequestFor(voxels, 100.5);
  const Picture exact = PictureOf(voxels, request);
  CastRig rig(CastWaves());
  rig.volume.Take(first);
  const Picture coarse = rig.Cast(request);
  EXPECT_EQ(rig.cache.uploaded_bricks(), 0u);
  std::size_t shown = 0, shown_both = 0;
  for (std::size_t n = 0; n < exact.pixels(); ++n) {
    shown += exact.Shows(n) ? 1 : 0;
    shown_both += exact.Shows(n) && coarse.Shows(n) ? 1 : 0;
  }
  EXPECT_GT(shown_both, 0.9 * static_cast<double>(shown));
  whole.all = false;
  rig.volume.Take(whole);
  EXPECT_EQ(rig.Cast(request), exact);
}

TEST_F(BricksOnTheCard, IsCastAgainOnlyAfterAChange) {
  const VoxelArray voxels = CastWaves();
  CastRig rig(voxels);
  CastRequest request = VeiledRequestFor(voxels);
  const auto casts_anew = [&] {
    const std::uint64_t before = rig.caster.casts();
    rig.Cast(request);
    return rig.caster.casts() > before;
  };
  EXPECT_TRUE(casts_anew());
  EXPECT_FALSE(casts_anew());
  EXPECT_FALSE(rig.caster.Cast(rig.cache, request));
  rig.cache.TakeUp(rig.volume, SIZE_MAX);
  EXPECT_FALSE(rig.caster.Cast(rig.cache, request)) << "nothing was to be taken up";

  const std::vector<std::function<void(CastRequest&)>> changes{
      [](CastRequest& r) { r.size.width += 1; },
      [](CastRequest& r) { r.eye_D.x() += 1e-9; },
      [](CastRequest& r) { r.clip_from_D(0, 0) *= 1.01; },
      [](CastRequest& r) { r.surface.shown = false; },
      [](CastRequest& r) { r.surface.isovalue += 0.1; },
      [](CastRequest& r) { r.surface.free_above = true; },
      [](CastRequest& r) { r.surface.color.x() *= 0.5f; },
      [](CastRequest& r) { r.surface.coloring = SurfaceColoring::kSlope; },
      [](CastRequest& r) { r.surface.color_map = ColorMap::kHot; },
      [](CastRequest& r) { r.surface.window_min -= 1.0; },
      [](CastRequest& r) { r.surface.window_max += 1.0; },
      [](CastRequest& r) { r.surface.veil.shown = false; },
      [](CastRequest& r) { r.surface.veil.isovalue += 0.1; },
      [](CastRequest& r) { r.surface.veil.color.y() *= 0.5f; },
      [](CastRequest& r) { r.surface.veil.opacity *= 0.5; },
      [](CastRequest& r) { r.surface.crop.min.x() = 0.2; },
      [](CastRequest& r) { r.surface.crop.max.z() = 0.8; },
      [](CastRequest& r) { r.surface.planes[0].on = true; },
      [](CastRequest& r) { r.surface.planes[1].normal_I = Vec3::UnitY(); },
      [](CastRequest& r) { r.surface.planes[1].offset_voxels = 4.0; },
      [](CastRequest& r) { r.surface.caps = false; }};
  for (std::size_t n = 0; n < changes.size(); ++n) {
    changes[n](request);
    EXPECT_TRUE(casts_anew()) << n;
    EXPECT_FALSE(casts_anew()) << n;
  }
  EXPECT_EQ(rig.caster.casts(), 1 + changes.size());

  client::VolumeUpdate moved = testing::Edit(rig.volume, voxels, {});
  moved.placement->device_from_index.translation.x() = 1.0;
  rig.volume.Take(moved);
  rig.cache.TakeUp(rig.volume, SIZE_MAX);
  EXPECT_TRUE(casts_anew());
  VoxelArray other = voxels;
  for (float& value : other.values) value += 0.01f;
  rig.volume.Take(testing::Edit(rig.volume, other, {Vec3i(1, 1, 1)}));
  rig.cache.TakeUp(rig.volume, SIZE_MAX);
  EXPECT_TRUE(casts_anew());
  EXPECT_FALSE(casts_anew());

  const CastRequest last = request;
  request.size = {1 << 20, 90};
  EXPECT_THROW(rig.caster.Cast(rig.cache, request), Error);
  EXPECT_FALSE(rig.caster.Cast(rig.cache, last)) << "it has that still";
  request.size = {0, 90};
  EXPECT_FALSE(rig.caster.Cast(rig.cache, request));
}

// --- Memory

// Of a slab that is seen from above, the eye being over one corner.
struct SlabView {
  VoxelArray voxels = MakeVoxels({128, 32, 128}, [](int i, int j, int k) {
    return static_cast<float>(20.5 - j + 0.4 * std::sin(0.7 * i) + 0.3 * std::cos(0.9 * k));
  });
  Look look{Vec3(10.0, 70.0, 10.0), Vec3(50.0, 20.0, 50.0)};
  CastRequest request = testing::RequestFor(look, {}, voxels.size, kCastSize);
};

TEST_F(BricksOnTheCard, WhatIsNotSeenMakesRoomForWhatIs) {
  const SlabView slab;
  CastRig all(slab.voxels);
  const Picture exact = all.Cast(slab.request);
  const auto wanted = static_cast<std::size_t>(all.cache.uploaded_bricks());
  CastRig rig(slab.voxels, {}, LeafType::kFloat, BudgetOf(wanted + 60));
  // From the other side first, and back.
  CastRequest below = testing::RequestFor({Vec3(118.0, -50.0, 118.0), Vec3(80.0, 20.0, 80.0)}, {},
                                          slab.voxels.size, kCastSize);
  for (int n = 0; n < 3; ++n) {
    EXPECT_EQ(rig.Cast(below), all.Cast(below)) << n;
    EXPECT_FALSE(rig.cache.is_full());
    EXPECT_EQ(rig.Cast(slab.request), exact) << n;
    EXPECT_FALSE(rig.cache.is_full());
  }
  EXPECT_LE(rig.cache.bytes(), BudgetOf(wanted + 60 + BrickAtlas::kRow));
}

TEST_F(BricksOnTheCard, WithTooLittleMemoryTheNearPartIsExactAndTheWholeIsThere) {
  const SlabView slab;
  CastRig all(slab.voxels);
  const Picture exact = all.Cast(slab.request);
  const auto wanted = static_cast<std::size_t>(all.cache.uploaded_bricks());
  CastRig rig(slab.voxels, {}, LeafType::kFloat, BudgetOf(wanted / 2));
  // What was near before is far now.
  rig.Cast(testing::RequestFor({Vec3(118.0, 70.0, 118.0), Vec3(80.0, 20.0, 80.0)}, {},
                               slab.voxels.size, kCastSize));
  EXPECT_TRUE(rig.cache.is_full());
  const Picture seen = rig.Cast(slab.request);
  EXPECT_TRUE(rig.cache.is_full());
  std::vector<double> differ_at, all_at;
  for (std::size_t n = 0; n < seen.pixels(); ++n) {
    if (!exact.Shows(n)) continue;
    const Vec3 point = testing::PointOf(slab.request, {}, n, exact.depth[n]);
    // At the slab's edge a coarse cell may miss.
    const bool is_at_edge = std::max(point.x(), point.z()) > 118.0;
    EXPECT_TRUE(seen.Shows(n) || is_at_edge) << point.transpose();
    if (!seen.Shows(n)) continue;
    const double away = (point - slab.look.eye_I).norm();
    all_at.push_back(away);
    if (seen.depth[n] != exact.depth[n]) differ_at.push_back(away);
  }
  ASSERT_FALSE(differ_at.empty());
  std::sort(all_at.begin(), all_at.end());
  const double nearest = *std::min_element(differ_at.begin(), differ_at.end());
  EXPECT_GT(nearest, all_at[all_at.size() / 4]) << "the nearest quarter is exact";
  // The same view again is the same picture: it has come to an end.
  EXPECT_EQ(rig.Cast(slab.request), seen);
  // With a volume that fits, all is well.
  rig.volume.Take(testing::WholeVolume(CastWaves(), {}));
  EXPECT_EQ(rig.Cast(RequestFor(CastWaves())), PictureOf(CastWaves(), RequestFor(CastWaves())));
  EXPECT_FALSE(rig.cache.is_full());
}

// Two bricks in 2^36 voxels: far more than 3-D textures hold.
TEST_F(BricksOnTheCard, ASparseVolumeOfAnySizeIsDrawn) {
  const Vec3i size = Vec3i::Constant(4096);
  const Vec3 middle(2043.5, 2043.5, 3003.5);
  client::VolumeUpdate update;
  update.all = true;
  update.lattice.emplace().size = size;
  update.lattice->value_min = -3.0;
  update.lattice->value_max = 3.0;
  update.placement.emplace();
  update.complete.emplace();
  const Vec3i counts = update.lattice->BrickCounts();
  BrickMap bricks(counts, TypedBrick::Constant(LeafType::kFloat, -3.0f));
  for (int n = 0; n < 64; ++n) {
    const Vec3i brick =
        (middle / 8.0).cast<int>() + Vec3i(n >> 4, n >> 2 & 3, n & 3) - Vec3i::Constant(2);
    Brick values;
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Vec3 at = (8 * brick + Vec3i(v >> 6, v >> 3 & 7, v & 7)).cast<double>();
      values[static_cast<std::size_t>(v)] =
          static_cast<float>(std::clamp(9.0 - (at - middle).norm(), -3.0, 3.0));
    }
    bricks.Put(BrickNumber(brick, counts), TypedBrick::Of<float>(values));
    update.changed.push_back({BrickNumber(brick, counts), 1});
  }
  std::sort(update.changed.begin(), update.changed.end(),
            [](const BrickRun& a, const BrickRun& b) { return a.first < b.first; });
  update.bricks = bricks.Share();
  CastRig rig(CastWaves());
  rig.volume.Take(update);
  const Look look{middle + Vec3(20.0, 15.0, 30.0), middle};
  CastRequest request = testing::RequestFor(look, {}, size, kCastSize);
  request.surface.isovalue = 0.0;
  const Picture seen = rig.Cast(request);
  EXPECT_LT(rig.cache.bytes(), std::size_t{24} << 20);
  EXPECT_LE(rig.cache.uploaded_bricks(), 125u);
  int hits = 0;
  for (int y = 0; y < kCastSize.height; ++y) {
    for (int x = 0; x < kCastSize.width; ++x) {
      const Vec3 direction = testing::DirectionOf(look, {}, kCastSize, x, y).normalized();
      const double off = direction.cross(middle - look.eye_I).norm();
      const auto pixel = static_cast<std::size_t>(y * kCastSize.width + x);
      if (off < 8.8) {
        ASSERT_TRUE(seen.Shows(pixel)) << x << ' ' << y;
      }
      if (off > 9.1) {
        ASSERT_FALSE(seen.Shows(pixel)) << x << ' ' << y;
      }
      if (!seen.Shows(pixel)) continue;
      ++hits;
      EXPECT_NEAR((testing::PointOf(request, {}, pixel, seen.depth[pixel]) - middle).norm(), 9.0,
                  0.05);
    }
  }
  EXPECT_GT(hits, 1000);
}

// Against the value itself, not against another caster: some 10^5 rays of nine pictures.
TEST_F(BricksOnTheCard, ASphereIsWithinATwentiethOfAVoxelOnAHundredThousandRays) {
  const Vec3 middle(63.7, 64.2, 63.4);
  const double radius = 50.0;
  // Linear along each ray from the middle but for interpolation, which is 1 / (8 radius) off.
  CastRig rig(MakeVoxels({128, 128, 128}, [&](int i, int j, int k) {
    return static_cast<float>(std::clamp(radius - (Vec3(i, j, k) - middle).norm(), -4.0, 4.0));
  }));
  constexpr ImageSize kLarge{200, 200};
  int hits = 0;
  double worst = 0.0;
  for (const Look& look : testing::LooksAt({128, 128, 128})) {
    CastRequest request = testing::RequestFor(look, {}, {128, 128, 128}, kLarge);
    request.surface.isovalue = 0.0;
    const Picture seen = rig.Cast(request);
    if ((look.eye_I - middle).norm() > 1000.0) continue;  // a depth is coarser than a voxel there
    for (std::size_t n = 0; n < seen.pixels(); ++n) {
      if (!seen.Shows(n)) continue;
      ++hits;
      const Vec3 point = testing::PointOf(request, {}, n, seen.depth[n]);
      worst = std::max(worst, std::abs((point - middle).norm() - radius));
    }
  }
  EXPECT_GT(hits, 100000);
  EXPECT_LE(worst, 0.05);
}

}  // namespace
}  // namespace palpate::view
