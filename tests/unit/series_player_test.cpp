// Time series: which frames are shown, edits to them, memory, and playing by a clock of the test.
#include "server/session/series/series_player.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/error/error.h"
#include "server/volume/snapshot/brick_memory.h"
#include "tests/support/editable_session.h"
#include "tests/support/fake_importer.h"
#include "tests/support/patience.h"
#include "tests/support/refusal.h"
#include "tests/support/temporary_folder.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using test::Eventually;
using testing::kNever;
using testing::kQuiet;
using testing::Refusal;

// Bricks are cut off at every side.
const Vec3i kFrameSize(20, 17, 9);
constexpr int kFrames = 5;
constexpr std::uint64_t kSeriesBudgetBytes = std::uint64_t{64} << 20;

// A growing ball in a constant slab. The least and the greatest value come in different frames.
float ValueAt(int frame, int i, int j, int k) {
  if (i >= 16) return 3.0f;
  if (frame == 2 && i == 1 && j == 1 && k == 1) return -7.5f;
  if (frame == 3 && i == 1 && j == 1 && k == 1) return 60.0f;
  const double r = Vec3(i - 8, j - 8, k - 4).norm();
  return static_cast<float>(std::max(0.0, 10.0 + frame - r));
}

// What the session's loader needs.
struct SeriesFolder {
  test::TemporaryFolder folder_;
  std::shared_ptr<MemoryBudget> budget_ = MemoryBudget::Make(kSeriesBudgetBytes, LiveBrickBytes);
  VolumeLoader Loader() const {
    return {.import_program = testing::WriteFakeImporter(folder_.path()), .budget = budget_};
  }
};

class SeriesPlayerTest : public ::testing::Test,
                         protected SeriesFolder,
                         protected testing::EditableSession {
 protected:
  SeriesPlayerTest() : EditableSession(Loader()) {
    for (int frame = 0; frame < kFrames; ++frame) {
      const auto value = [&](int i, int j, int k) { return ValueAt(frame, i, j, k); };
      const std::string number = std::to_string(frame);
      files_.push_back(folder_.path() / ("t" + number + ".vdb"));
      testing::WriteFakeVolume(files_.back(), kFrameSize, value);
      testing::WriteFakeVolume(folder_.path() / ("all.vdb." + number), kFrameSize, value, kFrames);
    }
    EditableSession::Load("builtin:sphere:16");
  }

  VolumeState Load(const LoadRequest& request = {}) {
    return player_.Load(files_, request, kQuiet, kNever);
  }
  std::uint64_t Revision() const { return volume()->revision(); }

  // Voxels by a formula, with the least value of the whole series beyond them.
  static ContentHash HashOf(const std::function<float(int, int, int)>& value) {
    const BrickDirectory bricks(kFrameSize, [&](const Vec3i& brick) {
      Brick values{};
      for (int n = 0; n < kBrickVoxels; ++n) {
        const Vec3i v = brick * 8 + Vec3i(n >> 6, n >> 3 & 7, n & 7);
        const bool inside = (v.array() < kFrameSize.array()).all();
        values[n] = inside ? value(v.x(), v.y(), v.z()) : -7.5f;
      }
      return Leaf::Of(LeafType::kFloat, values);
    });
    return bricks.content_hash();
  }
  static ContentHash FrameHash(int frame) {
    return HashOf([&](int i, int j, int k) { return ValueAt(frame, i, j, k); });
  }
  bool Shows(int frame) {
    return Eventually([&, expected = FrameHash(frame)] { return hash() == expected; });
  }
  void Pass(int ms) { time_ms_ += ms; }
  // Waits until the player has looked several times whether there is a frame to show.
  void AwaitLooks() {
    EXPECT_TRUE(Eventually([&, before = looks_.load()] { return looks_ > before + 3; }));
  }
  bool HoldsAtMost(std::uint64_t bytes) {
    return Eventually([&] { return Held() <= bytes; });
  }
  // The memory held after everything unused is freed.
  std::uint64_t Held() {
    session().retired().WaitForFreed(std::chrono::seconds(60));
    return budget_->held_bytes();
  }
  // Paints a voxel, as an editor does.
  void Paint(const Vec3i& voxel, float value) {
    session().store().Edit([&](const auto& present) {
      return testing::PaintedBox(present->bricks(), voxel, voxel + Vec3i::Ones(),
                                 [&] { return value; });
    });
  }
  float At(const Vec3i& v) const {
    return volume()->bricks().Find(v.x(), v.y(), v.z())[VoxelInBrick(v.x(), v.y(), v.z())];
  }

  std::vector<fs::path> files_;
  std::atomic<std::int64_t> time_ms_ = 0;
  std::atomic<int> looks_ = 0;
  SeriesPlayer player_{session(), [this] {
                         ++looks_;
                         return SeriesPlayer::Clock::time_point(milliseconds(time_ms_));
                       }};
};

TEST_F(SeriesPlayerTest, LoadsAllFramesAndPausesAtTheFirst) {
  std::vector<double> fractions;
  const VolumeState state = player_.Load(
      files_, {.source = "ignored", .title = "t*.vdb", .normalized_isovalue = 0.25},
      [&](std::string_view, double fraction) { fractions.push_back(fraction); }, kNever);
  const VolumeMetadata& metadata = state.volume->metadata();
  EXPECT_EQ(metadata.value_min, -7.5);
  EXPECT_EQ(metadata.value_max, 60.0);
  EXPECT_EQ(metadata.frames, kFrames);
  EXPECT_EQ(metadata.source, "t*.vdb");
  EXPECT_EQ(state.volume->loaded_revision(), state.volume->revision());
  EXPECT_EQ(hash(), FrameHash(0));
  EXPECT_DOUBLE_EQ(session().settings().settings.isovalue, -7.5 + 0.25 * 67.5);
  EXPECT_TRUE(std::is_sorted(fractions.begin(), fractions.end()));
  EXPECT_EQ(fractions.back(), 1.0);
  const SeriesState series = player_.state();
  EXPECT_EQ(series.frames, 5u);
  EXPECT_EQ(series.position_frames, 0.0);
  EXPECT_FALSE(series.playing || series.loop || series.interpolate);
  EXPECT_EQ(series.volume_revision, state.volume->revision());
  Pass(10'000);
  AwaitLooks();
  EXPECT_EQ(Revision(), state.volume->revision());
}

// From five files, and from one file with five frames.
TEST_F(SeriesPlayerTest, EveryFrameIsThatOfItsFileAtOneRevisionMore) {
  for (const auto& files : {files_, std::vector<fs::path>{folder_.path() / "all.vdb"}}) {
    player_.Load(files, {}, kQuiet, kNever);
    EXPECT_EQ(player_.state().frames, 5u);
    for (const int frame : {4, 0, 2, 3, 1}) {
      const std::uint64_t before = Revision();
      player_.Control({.position_frames = frame});
      ASSERT_TRUE(Shows(frame)) << frame;
      EXPECT_EQ(Revision(), before + 1);
      EXPECT_EQ(player_.state().position_frames, frame);
    }
  }
}

TEST_F(SeriesPlayerTest, AControlNamesTheFrameThatItWaitedFor) {
  // Between any two looks of this player, two frames pass.
  std::atomic<int> time_ms = 0;
  SeriesPlayer player(session(),
                      [&] { return SeriesPlayer::Clock::time_point(milliseconds(++time_ms)); });
  player.Load(files_, {}, kQuiet, kNever);
  for (int n = 1; n <= 20; ++n) {
    const int frame = 2 * n % kFrames;
    const std::uint64_t before = Revision();
    const SeriesControlled felt = player.Control(
        {.playing = n > 10, .position_frames = frame, .rate_hz = 1000.0, .loop = true});
    EXPECT_EQ(felt.series.position_frames, frame);
    if (n > 10) continue;  // it plays on
    EXPECT_EQ(felt.series.volume_revision, before + 1);
    EXPECT_EQ(hash(), FrameHash(frame));
    EXPECT_EQ(felt.scene_revision, session().volume().scene_revision);
    // A frame that is there already is no change.
    EXPECT_EQ(player.Control({.playing = false}).series.volume_revision, before + 1);
  }
}

TEST_F(SeriesPlayerTest, WhatIsEqualIsSharedAndCountedOnce) {
  Load();
  const std::uint64_t dense = BrickDirectory::MemoryBytes(kFrameSize);
  const SeriesState state = player_.state();
  // The slab is the same brick in all frames but for its corners.
  EXPECT_LT(state.memory_bytes, kFrames * dense * 9 / 10);
  EXPECT_GT(state.memory_bytes, dense);
  // The leaves, but not what the directory takes beside its blocks.
  EXPECT_TRUE(HoldsAtMost(state.memory_bytes));
  EXPECT_GT(Held(), state.memory_bytes - kFrames * 64);
  const BrickDirectory first = volume()->bricks();
  player_.Control({.position_frames = 1});
  ASSERT_TRUE(Shows(1));
  const BrickDirectory second = volume()->bricks();
  EXPECT_EQ(first.At(Vec3i(2, 0, 0)), second.At(Vec3i(2, 0, 0)));
  // And only what differs is said to have changed.
  EXPECT_EQ(second.ChangedSince(Revision() - 1).size(), first.ChangesTo(second).size());
}

TEST_F(SeriesPlayerTest, HalfWayIsTheMean) {
  Load();
  player_.Control({.position_frames = 2.5, .interpolate = true});
  const ContentHash mean = HashOf([](int i, int j, int k) {
    return static_cast<float>(0.5 * ValueAt(2, i, j, k) + 0.5 * ValueAt(3, i, j, k));
  });
  EXPECT_TRUE(Eventually([&] { return hash() == mean; }));
  EXPECT_EQ(player_.state().position_frames, 2.5);
  player_.Control({.position_frames = 3.25});
  EXPECT_TRUE(Eventually([&] {
    return At(Vec3i(1, 1, 1)) == static_cast<float>(0.75 * 60.0 + 0.25 * ValueAt(4, 1, 1, 1));
  }));
  // Without interpolation it is the frame before it.
  player_.Control({.interpolate = false});
  EXPECT_TRUE(Shows(3));
  EXPECT_EQ(player_.state().position_frames, 3.0);
  player_.Control({.position_frames = 4.0, .interpolate = true});
  EXPECT_TRUE(Shows(4));
}

TEST_F(SeriesPlayerTest, EditsStayInTheirFrame) {
  Load();
  player_.Control({.position_frames = 1});
  ASSERT_TRUE(Shows(1));
  const std::uint64_t held = player_.state().memory_bytes;
  const Vec3i voxel(5, 5, 5);
  Paint(voxel, 42.0f);
  // Nothing takes it back while the frame stays.
  AwaitLooks();
  EXPECT_EQ(At(voxel), 42.0f);
  player_.Control({.position_frames = 2});
  ASSERT_TRUE(Shows(2));
  EXPECT_EQ(player_.state().memory_bytes, held + Leaf::Bytes(LeafType::kFloat));
  player_.Control({.position_frames = 1});
  ASSERT_TRUE(Eventually([&] { return At(voxel) == 42.0f; }));
  EXPECT_EQ(At(Vec3i(1, 1, 1)), ValueAt(1, 1, 1, 1));
  // A blend is made of what was edited.
  player_.Control({.position_frames = 1.5, .interpolate = true});
  EXPECT_TRUE(Eventually(
      [&] { return At(voxel) == static_cast<float>(0.5 * 42.0 + 0.5 * ValueAt(2, 5, 5, 5)); }));
  // Edited again and again it takes no more memory than once.
  for (int n = 0; n < 5; ++n) {
    player_.Control({.position_frames = 1});
    ASSERT_TRUE(Eventually([&] { return At(voxel) == 42.0f + static_cast<float>(n); }));
    Paint(voxel, 43.0f + static_cast<float>(n));
    player_.Control({.position_frames = 3});
    ASSERT_TRUE(Shows(3));
  }
  EXPECT_EQ(player_.state().memory_bytes, held + Leaf::Bytes(LeafType::kFloat));
}

TEST_F(SeriesPlayerTest, EditsBetweenFramesAreLost) {
  Load();
  player_.Control({.position_frames = 1.5, .interpolate = true});
  ASSERT_TRUE(Eventually([&] { return hash() != FrameHash(0); }));
  Paint(Vec3i(5, 5, 5), 42.0f);
  for (const int frame : {1, 2}) {
    player_.Control({.position_frames = frame});
    EXPECT_TRUE(Shows(frame));
  }
}

TEST_F(SeriesPlayerTest, WithoutRoomForABlendTheFrameBeforeItIsShown) {
  Load();
  const MemoryClaim rest = budget_->Claim("a test", kSeriesBudgetBytes - Held());
  Paint(Vec3i(5, 5, 5), 42.0f);
  player_.Control({.position_frames = 1});
  EXPECT_TRUE(Shows(1));
  player_.Control({.position_frames = 2.5, .interpolate = true});
  EXPECT_TRUE(Shows(2));
  player_.Control({.position_frames = 0});
  // What was edited is there already, and stays.
  EXPECT_TRUE(Eventually([&] { return At(Vec3i(5, 5, 5)) == 42.0f; }));
}

// As after a replay.
TEST_F(SeriesPlayerTest, OtherRevisionsAreNoEditsOfAFrame) {
  Load();
  Paint(Vec3i(3, 3, 3), 5.0f);
  for (const int frame : {1, 0}) player_.Control({.position_frames = frame});
  session().store().Edit([&](const auto& present) {
    VolumeChange change;
    change.renumbered = testing::Renumbered(*present, 40);
    return change;
  });
  const std::uint64_t bytes = player_.state().memory_bytes;
  for (const int frame : {1, 0, 4, 0}) {
    player_.Control({.position_frames = frame});
    EXPECT_TRUE(frame == 0 || Shows(frame)) << frame;
    EXPECT_EQ(At(Vec3i(3, 3, 3)) == 5.0f, frame == 0);
  }
  EXPECT_EQ(player_.state().memory_bytes, bytes);
}

TEST_F(SeriesPlayerTest, AnotherVolumeEndsIt) {
  Load();
  player_.Control({.playing = true, .rate_hz = 50.0, .loop = true, .interpolate = true});
  EditableSession::Load("builtin:gyroid:16");
  const auto other = volume();
  EXPECT_EQ(Refusal([&] { player_.state(); }), ErrorKind::kConflict);
  EXPECT_EQ(Refusal([&] { player_.Control({.playing = false}); }), ErrorKind::kConflict);
  Pass(30);
  EXPECT_TRUE(HoldsAtMost(other->bricks().MemoryBytes()));
  EXPECT_EQ(volume(), other);
  // And it can come again.
  Load();
  EXPECT_EQ(hash(), FrameHash(0));
  EXPECT_FALSE(player_.state().playing);
}

TEST_F(SeriesPlayerTest, ASeriesReplacesASeries) {
  Load();
  player_.Control({.playing = true, .rate_hz = 50.0, .loop = true});
  player_.Load(std::span(files_).subspan(2, 2), {}, kQuiet, kNever);
  EXPECT_EQ(player_.state().frames, 2u);
  EXPECT_FALSE(player_.state().playing);
  EXPECT_EQ(hash(), FrameHash(2));
  EXPECT_EQ(Refusal([&] { player_.Control({.position_frames = 2.0}); }),
            ErrorKind::kInvalidArgument);
  EXPECT_TRUE(HoldsAtMost(player_.state().memory_bytes));
}

TEST_F(SeriesPlayerTest, BadControlsChangeNothing) {
  Load();
  player_.Control({.position_frames = 1, .rate_hz = -3.0});
  ASSERT_TRUE(Shows(1));
  const double nan = std::nan("");
  for (const ControlSeriesRequest& bad :
       {ControlSeriesRequest{.position_frames = -0.001},
        ControlSeriesRequest{.position_frames = 4.001},
        ControlSeriesRequest{.position_frames = nan},
        ControlSeriesRequest{.position_frames = HUGE_VAL}, ControlSeriesRequest{.rate_hz = 0.0},
        ControlSeriesRequest{.rate_hz = nan}, ControlSeriesRequest{.rate_hz = -0.0},
        ControlSeriesRequest{.rate_hz = 1000.1}, ControlSeriesRequest{.rate_hz = -HUGE_VAL},
        ControlSeriesRequest{
            .playing = true, .position_frames = 2, .rate_hz = 1001.0, .loop = true}}) {
    EXPECT_EQ(Refusal([&] { player_.Control(bad); }), ErrorKind::kInvalidArgument);
  }
  const SeriesState state = player_.state();
  EXPECT_EQ(state.position_frames, 1.0);
  EXPECT_EQ(state.rate_hz, -3.0);
  EXPECT_FALSE(state.playing || state.loop);
  EXPECT_EQ(hash(), FrameHash(1));
}

TEST_F(SeriesPlayerTest, ABadSeriesKeepsTheVolumeAndHoldsNothing) {
  const auto before = volume();
  const std::uint64_t held = Held();
  const fs::path other = folder_.path() / "other.vdb";
  testing::WriteFakeVolume(other, Vec3i(20, 17, 10),
                           [](int i, int, int) { return static_cast<float>(i); });
  const auto refusal = [&](const std::vector<fs::path>& files) {
    return Refusal([&] { player_.Load(files, {}, kQuiet, kNever); });
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
  EXPECT_EQ(Refusal([&] { player_.Load(files_, {}, kQuiet, [&] { return ++asked > 8; }); }),
            ErrorKind::kCancelled);
  EXPECT_EQ(volume(), before);
  EXPECT_EQ(Held(), held);
  EXPECT_EQ(Refusal([&] { player_.state(); }), ErrorKind::kConflict);
}

TEST_F(SeriesPlayerTest, ASeriesBeyondTheBudgetIsRefusedBeforeItIsRead) {
  const auto before = volume();
  // All frames but one, one on its way, and what hands it over.
  const std::uint64_t room = kFrames * BrickDirectory::MemoryBytes(kFrameSize) +
                             sizeof(float) * static_cast<std::uint64_t>(kFrameSize.prod()) +
                             StripBytes(kFrameSize, LeafType::kFloat);
  const MemoryClaim rest = budget_->Claim("a test", kSeriesBudgetBytes - Held() - room);
  // The first file is not there: only its size is said.
  const fs::path huge = folder_.path() / "huge";
  std::ofstream(huge.string() + ".size") << "size 20 17 9 4\n";
  std::vector<fs::path> files = files_;
  files[0] = huge;
  EXPECT_EQ(Refusal([&] { player_.Load(files, {}, kQuiet, kNever); }), ErrorKind::kTooLarge);
  EXPECT_EQ(Refusal([&] { Load(); }), ErrorKind::kTooLarge);
  const fs::path all = folder_.path() / "all.vdb";
  EXPECT_EQ(Refusal([&] { player_.Load(std::vector{all}, {}, kQuiet, kNever); }),
            ErrorKind::kTooLarge);
  EXPECT_EQ(volume(), before);
  // One frame less fits.
  player_.Load(std::span(files_).first(kFrames - 1), {}, kQuiet, kNever);
  EXPECT_EQ(hash(), FrameHash(0));
}

TEST_F(SeriesPlayerTest, OneLoadAtATime) {
  const std::unique_lock loading = session().BeginLoad();
  std::optional<ErrorKind> kind;
  std::thread([&] { kind = Refusal([&] { Load(); }); }).join();
  EXPECT_EQ(kind, ErrorKind::kConflict);
}

TEST_F(SeriesPlayerTest, PlaysToEitherEndAndStopsAndBeginsAnew) {
  Load();
  for (const double rate_hz : {10.0, 10.0, -10.0, -10.0}) {
    if (rate_hz < 0.0) {
      player_.Control({.position_frames = 0.0});
      ASSERT_TRUE(Shows(0));
    }
    player_.Control({.playing = true, .rate_hz = rate_hz});
    for (int n = 0; n < kFrames; ++n) {
      EXPECT_TRUE(Shows(rate_hz > 0.0 ? n : kFrames - 1 - n)) << rate_hz << ", " << n;
      Pass(105);
    }
    EXPECT_TRUE(Eventually([&] { return !player_.state().playing; }));
    EXPECT_EQ(player_.state().position_frames, rate_hz > 0.0 ? 4.0 : 0.0);
    AwaitLooks();
    EXPECT_EQ(hash(), FrameHash(rate_hz > 0.0 ? 4 : 0));
  }
}

TEST_F(SeriesPlayerTest, LoopsInBothDirectionsAndAPauseHoldsTheFrame) {
  Load();
  for (const int direction : {1, -1}) {
    player_.Control(
        {.playing = true, .position_frames = 0.0, .rate_hz = 10.0 * direction, .loop = true});
    for (int n = 1; n <= 12; ++n) {
      Pass(105);
      const double position = std::fmod(100.0 + 1.05 * n * direction, 5.0);
      EXPECT_TRUE(Shows(static_cast<int>(position))) << direction << ", " << n;
    }
  }
  EXPECT_TRUE(player_.state().playing);
  player_.Control({.playing = false});
  const double position = player_.state().position_frames;
  const std::uint64_t revision = Revision();
  Pass(10'000);
  AwaitLooks();
  EXPECT_EQ(Revision(), revision);
  EXPECT_EQ(player_.state().position_frames, position);
}

// A slow machine only makes it take longer.
TEST_F(SeriesPlayerTest, AtMostSixtyVolumesPerSecondHoweverFast) {
  Load();
  player_.Control({.playing = true, .rate_hz = 1000.0, .loop = true, .interpolate = true});
  for (const bool seeking : {false, true}) {
    const std::uint64_t before = Revision();
    const auto start = std::chrono::steady_clock::now();
    int frame = 0;
    EXPECT_TRUE(Eventually([&] {
      Pass(1);
      if (seeking) player_.Control({.playing = false, .position_frames = ++frame % kFrames});
      return Revision() >= before + 12;
    }));
    EXPECT_GE(std::chrono::steady_clock::now() - start, milliseconds(10 * 1000 / 60));
  }
}

// Ends in the middle of everything.
TEST_F(SeriesPlayerTest, EditsLoadsAndControlsAtOnce) {
  auto player = std::make_unique<SeriesPlayer>(session());
  const auto load = [&] { player->Load(files_, {}, kQuiet, kNever); };
  load();
  player->Control({.playing = true, .rate_hz = 120.0, .loop = true, .interpolate = true});
  std::atomic<bool> stop{false};
  std::atomic<int> edits{0}, controls{0};
  std::thread editor([&] {
    for (; !stop; ++edits) {
      if (volume()->size() == kFrameSize) Paint(Vec3i(edits % 16, 5, 5), 1.0f);
      std::this_thread::sleep_for(milliseconds(1));
    }
  });
  std::thread steerer([&] {
    for (; !stop; ++controls) {
      const int n = controls;
      const auto kind = Refusal([&] {
        player->Control({.position_frames = n % kFrames, .interpolate = n % 2 == 0});
        player->state();
      });
      EXPECT_EQ(kind.value_or(ErrorKind::kConflict), ErrorKind::kConflict);
    }
  });
  for (int n = 1; n <= 4; ++n) {
    EXPECT_TRUE(Eventually([&] { return edits > 30 * n && controls > 30 * n; }));
    EditableSession::Load("builtin:sphere:16");
    load();
    player->Control({.playing = true, .rate_hz = -77.0, .loop = true});
  }
  stop = true;
  editor.join();
  steerer.join();
  player.reset();
  EXPECT_EQ(volume()->size(), kFrameSize);
}

}  // namespace
}  // namespace palpate
