// Time series under a running servo loop, without gRPC.
#include "server/session/series_player.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <thread>

#include "common/error/error.h"
#include "server/volume/brick_pool.h"
#include "tests/support/refusal.h"
#include "tests/support/series_rig.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using std::chrono::steady_clock;
using namespace testing;

TEST_F(SeriesPlayerTest, LoadsAllFramesAndPausesAtTheFirst) {
  std::vector<double> fractions;
  const VolumeState state = player_->Load(
      files_, {.source = "ignored", .title = "t*.vdb", .normalized_isovalue = 0.25},
      [&](std::string_view, double fraction) { fractions.push_back(fraction); }, kNever);
  const VolumeMetadata& metadata = state.volume->metadata();
  EXPECT_EQ(metadata.value_min, -7.5);
  EXPECT_EQ(metadata.value_max, 60.0);
  EXPECT_EQ(metadata.frames, kFrames);
  EXPECT_EQ(metadata.source, "t*.vdb");
  EXPECT_EQ(state.volume->loaded_revision(), state.volume->revision());
  EXPECT_EQ(Hash(), FrameHash(0));
  EXPECT_DOUBLE_EQ(session_->settings().settings.isovalue, -7.5 + 0.25 * 67.5);
  EXPECT_TRUE(std::is_sorted(fractions.begin(), fractions.end()));
  EXPECT_EQ(fractions.back(), 1.0);
  const SeriesState series = player_->state();
  EXPECT_EQ(series.frames, 5u);
  EXPECT_EQ(series.position_frames, 0.0);
  EXPECT_FALSE(series.playing || series.loop || series.interpolate);
  EXPECT_EQ(series.volume_revision, state.volume->revision());
  std::this_thread::sleep_for(milliseconds(150));
  EXPECT_EQ(Revision(), state.volume->revision());
}

TEST_F(SeriesPlayerTest, EveryFrameIsThatOfItsFileAtOneRevisionMore) {
  Load();
  for (const int frame : {4, 0, 2, 3, 1}) {
    const std::uint64_t before = Revision();
    player_->Control({.position_frames = frame});
    ASSERT_TRUE(Shows(frame)) << frame;
    EXPECT_EQ(Revision(), before + 1);
    EXPECT_EQ(player_->state().position_frames, frame);
    EXPECT_NO_THROW(session_->WaitForServo(session_->volume().scene_revision));
  }
}

TEST_F(SeriesPlayerTest, OneFileWithSeveralFramesIsTheSame) {
  player_->Load(std::vector<fs::path>{folder_.path() / "all.vdb"}, {}, kQuiet, kNever);
  EXPECT_EQ(player_->state().frames, 5u);
  for (const int frame : {3, 1, 4}) {
    player_->Control({.position_frames = frame});
    EXPECT_TRUE(Shows(frame)) << frame;
  }
}

TEST_F(SeriesPlayerTest, WhatIsEqualIsSharedAndCountedOnce) {
  Load();
  const std::uint64_t dense = BrickDirectory::MemoryBytes(kSize);
  const SeriesState state = player_->state();
  // The slab is the same brick in all frames but for its corners.
  EXPECT_LT(state.memory_bytes, kFrames * dense * 9 / 10);
  EXPECT_GT(state.memory_bytes, dense);
  // The leaves, but not what the directory takes beside its blocks.
  EXPECT_LE(HeldSoon(), state.memory_bytes);
  EXPECT_GT(HeldSoon(), state.memory_bytes - kFrames * 64);
  const BrickDirectory first = session_->volume().volume->bricks();
  player_->Control({.position_frames = 1});
  ASSERT_TRUE(Shows(1));
  EXPECT_EQ(first.At(Vec3i(2, 0, 0)), session_->volume().volume->bricks().At(Vec3i(2, 0, 0)));
  // And only what differs is said to have changed.
  const VolumeState now = session_->volume();
  EXPECT_EQ(now.volume->bricks().ChangedSince(now.volume->revision() - 1).size(),
            first.ChangesTo(now.volume->bricks()).size());
}

TEST_F(SeriesPlayerTest, HalfWayIsTheMean) {
  Load();
  player_->Control({.position_frames = 2.5, .interpolate = true});
  const ContentHash mean =
      Directory([](int i, int j, int k) {
        return static_cast<float>(0.5 * ValueAt(2, i, j, k) + 0.5 * ValueAt(3, i, j, k));
      }).content_hash();
  EXPECT_TRUE(Soon([&] { return Hash() == mean; }));
  EXPECT_EQ(player_->state().position_frames, 2.5);
  player_->Control({.position_frames = 3.25});
  EXPECT_TRUE(Soon([&] {
    return At(Vec3i(1, 1, 1)) == static_cast<float>(0.75 * 60.0 + 0.25 * ValueAt(4, 1, 1, 1));
  }));
  // Without interpolation it is the frame before it.
  player_->Control({.interpolate = false});
  EXPECT_TRUE(Shows(3));
  EXPECT_EQ(player_->state().position_frames, 3.0);
  player_->Control({.position_frames = 4.0, .interpolate = true});
  EXPECT_TRUE(Shows(4));
}

TEST_F(SeriesPlayerTest, EditsStayInTheirFrame) {
  Load();
  player_->Control({.position_frames = 1});
  ASSERT_TRUE(Shows(1));
  const std::uint64_t held = player_->state().memory_bytes;
  const Vec3i voxel(5, 5, 5);
  Paint(voxel, 42.0f);
  // Nothing takes it back while the frame stays.
  std::this_thread::sleep_for(milliseconds(150));
  EXPECT_EQ(At(voxel), 42.0f);
  player_->Control({.position_frames = 2});
  ASSERT_TRUE(Shows(2));
  EXPECT_EQ(player_->state().memory_bytes, held + Leaf::Bytes(LeafType::kFloat));
  player_->Control({.position_frames = 1});
  ASSERT_TRUE(Soon([&] { return At(voxel) == 42.0f; }));
  EXPECT_EQ(At(Vec3i(1, 1, 1)), ValueAt(1, 1, 1, 1));
  // A blend is made of what was edited.
  player_->Control({.position_frames = 1.5, .interpolate = true});
  EXPECT_TRUE(Soon(
      [&] { return At(voxel) == static_cast<float>(0.5 * 42.0 + 0.5 * ValueAt(2, 5, 5, 5)); }));
  // Edited again and again it takes no more memory than once.
  for (int n = 0; n < 5; ++n) {
    player_->Control({.position_frames = 1});
    ASSERT_TRUE(Soon([&] { return At(voxel) == 42.0f + static_cast<float>(n); }));
    Paint(voxel, 43.0f + static_cast<float>(n));
    player_->Control({.position_frames = 3});
    ASSERT_TRUE(Shows(3));
  }
  EXPECT_EQ(player_->state().memory_bytes, held + Leaf::Bytes(LeafType::kFloat));
}

TEST_F(SeriesPlayerTest, EditsBetweenFramesAreLost) {
  Load();
  player_->Control({.position_frames = 1.5, .interpolate = true});
  ASSERT_TRUE(Soon([&] { return Hash() != FrameHash(0); }));
  Paint(Vec3i(5, 5, 5), 42.0f);
  for (const int frame : {1, 2}) {
    player_->Control({.position_frames = frame});
    EXPECT_TRUE(Shows(frame));
  }
}

TEST_F(SeriesPlayerTest, WithoutRoomForABlendTheFrameBeforeItIsShown) {
  Load();
  const MemoryClaim rest = budget_->Claim("a test", kBudgetBytes - HeldSoon());
  Paint(Vec3i(5, 5, 5), 42.0f);
  player_->Control({.position_frames = 1});
  EXPECT_TRUE(Shows(1));
  player_->Control({.position_frames = 2.5, .interpolate = true});
  EXPECT_TRUE(Shows(2));
  player_->Control({.position_frames = 0});
  // What was edited is there already, and stays.
  EXPECT_TRUE(Soon([&] { return At(Vec3i(5, 5, 5)) == 42.0f; }));
}

TEST_F(SeriesPlayerTest, VoxelsThatAreHeldAreNoEditsOfAFrame) {
  Load();
  auto hold = std::make_unique<VolumeStore::Hold>(session_->store());
  const BrickDirectory before = session_->volume().volume->bricks();
  Paint(Vec3i(3, 3, 3), 5.0f);
  player_->Control({.playing = true, .rate_hz = 100.0, .loop = true});
  std::this_thread::sleep_for(milliseconds(200));
  EXPECT_EQ(At(Vec3i(3, 3, 3)), 5.0f);  // no frame was shown
  player_->Control({.playing = false, .position_frames = 0.0});
  session_->store().Edit([&](const auto& present) { return present->bricks().ChangesTo(before); });
  hold.reset();
  for (const int frame : {1, 0, 4, 0}) {
    player_->Control({.position_frames = frame});
    EXPECT_TRUE(Shows(frame)) << frame;
  }
}

TEST_F(SeriesPlayerTest, NothingIsShownAfterTheStop) {
  Load();
  player_->Control({.playing = true, .rate_hz = 100.0, .loop = true});
  player_->Stop();
  const std::uint64_t revision = Revision();
  std::this_thread::sleep_for(milliseconds(100));
  EXPECT_EQ(Revision(), revision);
}

TEST_F(SeriesPlayerTest, AnotherVolumeEndsIt) {
  Load();
  player_->Control({.playing = true, .rate_hz = 50.0, .loop = true, .interpolate = true});
  AppliedTick applied;
  const VolumeState other =
      session_->LoadAndWait({.source = "builtin:gyroid:16"}, kQuiet, kNever, applied);
  EXPECT_EQ(Refusal([&] { player_->state(); }), ErrorKind::kConflict);
  EXPECT_EQ(Refusal([&] { player_->Control({.playing = false}); }), ErrorKind::kConflict);
  std::this_thread::sleep_for(milliseconds(200));
  EXPECT_EQ(Revision(), other.volume->revision());
  EXPECT_LE(HeldSoon(), other.volume->bricks().MemoryBytes());
  // And it can come again.
  Load();
  EXPECT_EQ(Hash(), FrameHash(0));
  EXPECT_FALSE(player_->state().playing);
}

TEST_F(SeriesPlayerTest, ASeriesReplacesASeries) {
  Load();
  player_->Control({.playing = true, .rate_hz = 50.0, .loop = true});
  player_->Load(std::span(files_).subspan(2, 2), {}, kQuiet, kNever);
  EXPECT_EQ(player_->state().frames, 2u);
  EXPECT_FALSE(player_->state().playing);
  EXPECT_EQ(Hash(), FrameHash(2));
  EXPECT_EQ(Refusal([&] { player_->Control({.position_frames = 2.0}); }),
            ErrorKind::kInvalidArgument);
  EXPECT_LE(HeldSoon(), player_->state().memory_bytes);
}

TEST_F(SeriesPlayerTest, WithoutASeriesThereIsNothingToControl) {
  EXPECT_EQ(Refusal([&] { player_->state(); }), ErrorKind::kConflict);
  EXPECT_EQ(Refusal([&] { player_->Control({.playing = true}); }), ErrorKind::kConflict);
}

TEST_F(SeriesPlayerTest, BadControlsChangeNothing) {
  Load();
  player_->Control({.position_frames = 1, .rate_hz = -3.0});
  ASSERT_TRUE(Shows(1));
  const double nan = std::nan("");
  for (const SeriesControl& bad :
       {SeriesControl{.position_frames = -0.001}, SeriesControl{.position_frames = 4.001},
        SeriesControl{.position_frames = nan}, SeriesControl{.position_frames = HUGE_VAL},
        SeriesControl{.rate_hz = 0.0}, SeriesControl{.rate_hz = nan},
        SeriesControl{.rate_hz = -0.0}, SeriesControl{.rate_hz = 1000.1},
        SeriesControl{.rate_hz = -HUGE_VAL},
        SeriesControl{.playing = true, .position_frames = 2, .rate_hz = 1001.0, .loop = true}}) {
    EXPECT_EQ(Refusal([&] { player_->Control(bad); }), ErrorKind::kInvalidArgument);
  }
  const SeriesState state = player_->state();
  EXPECT_EQ(state.position_frames, 1.0);
  EXPECT_EQ(state.rate_hz, -3.0);
  EXPECT_FALSE(state.playing || state.loop);
  EXPECT_EQ(Hash(), FrameHash(1));
}

TEST_F(SeriesPlayerTest, ABadSeriesKeepsTheVolumeAndHoldsNothing) {
  const VolumeState before = session_->volume();
  const std::uint64_t held = HeldSoon();
  const fs::path other = folder_.path() / "other.vdb";
  testing::WriteFakeVolume(other, Vec3i(20, 17, 10),
                           [](int i, int, int) { return static_cast<float>(i); });
  const auto refusal = [&](const std::vector<fs::path>& files) {
    return Refusal([&] { player_->Load(files, {}, kQuiet, kNever); });
  };
  EXPECT_EQ(refusal({files_[0]}), ErrorKind::kInvalidArgument);  // one frame
  EXPECT_EQ(refusal({files_[0], other}), ErrorKind::kInvalidArgument);
  EXPECT_EQ(refusal({files_[0], folder_.path() / "absent"}), ErrorKind::kNotFound);
  // Frames in one of several files.
  fs::copy(folder_.path() / "all.vdb.0", folder_.path() / "all.vdb");
  EXPECT_EQ(refusal({files_[0], folder_.path() / "all.vdb"}), ErrorKind::kInvalidArgument);
  // Only published at the end, and only with a good isovalue.
  EXPECT_EQ(Refusal([&] { Load({.source = "ignored", .isovalue = 99.0}); }),
            ErrorKind::kInvalidArgument);
  int asked = 0;
  EXPECT_EQ(Refusal([&] { player_->Load(files_, {}, kQuiet, [&] { return ++asked > 8; }); }),
            ErrorKind::kCancelled);
  EXPECT_EQ(session_->volume().volume, before.volume);
  EXPECT_EQ(HeldSoon(), held);
  EXPECT_EQ(Refusal([&] { player_->state(); }), ErrorKind::kConflict);
}

TEST_F(SeriesPlayerTest, ASeriesBeyondTheBudgetIsRefusedBeforeItIsRead) {
  const VolumeState before = session_->volume();
  // All frames but one, one on its way, and what hands it over.
  const std::uint64_t room = kFrames * BrickDirectory::MemoryBytes(kSize) +
                             sizeof(float) * static_cast<std::uint64_t>(kSize.prod()) +
                             StripBytes(kSize, LeafType::kFloat);
  const MemoryClaim rest = budget_->Claim("a test", kBudgetBytes - HeldSoon() - room);
  // The first file is not there: only its size is said.
  const fs::path huge = folder_.path() / "huge";
  std::ofstream(huge.string() + ".size") << "size 20 17 9 4\n";
  std::vector<fs::path> files = files_;
  files[0] = huge;
  EXPECT_EQ(Refusal([&] { player_->Load(files, {}, kQuiet, kNever); }), ErrorKind::kTooLarge);
  EXPECT_EQ(Refusal([&] { Load(); }), ErrorKind::kTooLarge);
  const fs::path all = folder_.path() / "all.vdb";
  EXPECT_EQ(Refusal([&] { player_->Load(std::vector{all}, {}, kQuiet, kNever); }),
            ErrorKind::kTooLarge);
  EXPECT_EQ(session_->volume().volume, before.volume);
  // One frame less fits.
  player_->Load(std::span(files_).first(kFrames - 1), {}, kQuiet, kNever);
  EXPECT_EQ(Hash(), FrameHash(0));
}

TEST_F(SeriesPlayerTest, OneLoadAtATime) {
  const std::unique_lock loading = session_->BeginLoad();
  std::optional<ErrorKind> kind;
  std::thread([&] { kind = Refusal([&] { Load(); }); }).join();
  EXPECT_EQ(kind, ErrorKind::kConflict);
}

// Ends in the middle of everything.
TEST_F(SeriesPlayerTest, EditsLoadsAndControlsAtOnce) {
  Load();
  player_->Control({.playing = true, .rate_hz = 120.0, .loop = true, .interpolate = true});
  std::atomic<bool> stop{false};
  std::thread editor([&] {
    for (int n = 0; !stop; ++n) {
      if (session_->volume().volume->size() == kSize) Paint(Vec3i(n % 16, 5, 5), 1.0f);
      std::this_thread::sleep_for(milliseconds(1));
    }
  });
  std::thread steerer([&] {
    for (int n = 0; !stop; ++n) {
      try {
        player_->Control({.position_frames = n % kFrames, .interpolate = n % 2 == 0});
        player_->state();
      } catch (const Error& error) {
        EXPECT_EQ(error.kind(), ErrorKind::kConflict);
      }
    }
  });
  for (int n = 0; n < 4; ++n) {
    std::this_thread::sleep_for(milliseconds(100));
    session_->Load({.source = "builtin:sphere:16"}, kQuiet, kNever);
    Load();
    player_->Control({.playing = true, .rate_hz = -77.0, .loop = true});
  }
  stop = true;
  editor.join();
  steerer.join();
  player_.reset();
  EXPECT_EQ(session_->volume().volume->size(), kSize);
}

TEST(BrickPool, KeepsEveryBitPatternOnce) {
  BrickPool pool;
  const auto filled = [](float value) {
    Brick brick{};
    brick.fill(value);
    return Leaf::Of(LeafType::kFloat, brick);
  };
  const LeafPtr zero = pool.Share(filled(0.0f));
  EXPECT_EQ(pool.Share(filled(0.0f)), zero);
  EXPECT_NE(pool.Share(filled(-0.0f)), zero);
  EXPECT_NE(pool.Share(filled(1.0f)), zero);
  const LeafPtr nan = pool.Share(filled(std::numeric_limits<float>::quiet_NaN()));
  EXPECT_EQ(pool.Share(filled(std::numeric_limits<float>::quiet_NaN())), nan);
}

TEST(BrickPool, CountsTheMemoryOfSharedBricksOnce) {
  const Vec3i size(32, 8, 8);
  const auto directory = [&](float first) {
    return BrickDirectory(size, [&](const Vec3i& brick) {
      Brick values{};
      values.fill(static_cast<float>(brick.x()) + (brick.x() == 0 ? first : 0.0f));
      return Leaf::Of(LeafType::kFloat, values);
    });
  };
  BrickPool pool;
  const std::vector<BrickDirectory> shared = {pool.Share(directory(10.0f), size, 0.0f),
                                              pool.Share(directory(20.0f), size, 0.0f)};
  EXPECT_EQ(MemoryBytes(shared, size),
            2 * BrickDirectory::MemoryBytes(size) - 3 * Leaf::Bytes(LeafType::kFloat));
  EXPECT_EQ(shared[0].ChangesTo(shared[1]).size(), 1u);
  EXPECT_EQ(MemoryBytes(std::vector{directory(1.0f), directory(1.0f)}, size),
            2 * BrickDirectory::MemoryBytes(size));
  EXPECT_EQ(shared[0].MemoryBytes(), BrickDirectory::MemoryBytes(size));
}

}  // namespace
}  // namespace palpate
