// Filters of a session while others edit, load and cancel; without a servo.
#include "server/session/volume_filterer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <random>
#include <thread>

#include "common/error/error.h"
#include "server/device/path_script.h"
#include "server/device/simulated_device.h"
#include "server/volume/brick_memory.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using testing::Refusal;

const LoadProgress kQuiet = [](std::string_view, double) {};
const LoadCancelled kNever = [] { return false; };
constexpr std::uint64_t kBudgetBytes = std::uint64_t{64} << 20;

class VolumeFiltererTest : public ::testing::Test {
 protected:
  VolumeFiltererTest() {
    VolumeLoader loader;
    loader.budget = budget_;
    session_ = std::make_unique<Session>(device_.spec(), inbox_, pump_, loader);
    editor_ = std::make_unique<VolumeEditor>(*session_);
    filterer_ = std::make_unique<VolumeFilterer>(*session_, *editor_);
    session_->Load({.source = "builtin:bumps:72"}, kQuiet, kNever);
    loaded_ = Volume();
  }
  ~VolumeFiltererTest() override { inbox_.Collect(); }

  std::shared_ptr<const VolumeSnapshot> Volume() const { return session_->volume().volume; }
  ContentHash Hash() const { return Volume()->bricks().content_hash(); }

  EditOutcome Filter(const LoadProgress& progress = kQuiet, const LoadCancelled& cancelled = kNever,
                     const VolumeEditor::Revision& expected = {}) {
    return filterer_->Filter(filter_, expected, progress, cancelled);
  }

  EditOutcome Dig(double x, double y, double z, double radius = 3.0) {
    return editor_->Edit({.shape = SphereShape{Vec3(x, y, z), radius}, .value = 0.25});
  }
  EditOutcome DigSomewhere(std::mt19937& random) {
    std::uniform_real_distribution<double> place(0.0, 71.0);
    return Dig(place(random), place(random), place(random));
  }

  // What is held once all that nobody shows is freed. No servo takes scenes here.
  std::uint64_t HeldSoon() {
    inbox_.ReaderStopped();
    session_->retired().WaitForFreed(std::chrono::seconds(10));
    return budget_->held_bytes();
  }
  MemoryClaim LeaveOnly(std::uint64_t bytes) {
    return budget_->Claim("a test", kBudgetBytes - HeldSoon() - bytes);
  }

  // The last step is the filter of what was there before it, to the bit.
  void CheckFiltered(const EditOutcome& outcome) {
    EXPECT_EQ(Volume()->revision(), outcome.volume_revision);
    const ContentHash filtered = Hash();
    editor_->Undo();
    const auto before = Volume();
    const EditResult expected = ApplyFilter(before, filter_);
    EXPECT_EQ(before->bricks().With(expected.changes, 9999).content_hash(), filtered);
    EXPECT_EQ(outcome.changed_voxels, expected.changed_voxels);
    editor_->Redo();
    EXPECT_EQ(Hash(), filtered);
  }

  VolumeFilter filter_{.kind = FilterKind::kMean};
  SimulatedDevice device_{
      std::make_unique<PathScript>(std::vector<Vec3>{Vec3(-70, 2, 1), Vec3(70, 1, 2)}, 100.0)};
  SceneInbox inbox_;
  TickOutbox outbox_;
  Pump pump_{outbox_};
  const std::shared_ptr<MemoryBudget> budget_ = MemoryBudget::Make(kBudgetBytes, LiveBrickBytes);
  std::unique_ptr<Session> session_;
  std::unique_ptr<VolumeEditor> editor_;
  std::unique_ptr<VolumeFilterer> filterer_;
  std::shared_ptr<const VolumeSnapshot> loaded_;
};

TEST_F(VolumeFiltererTest, AFilterIsOneRevisionAndOneStep) {
  const ContentHash before = Hash();
  const std::uint64_t revision = Volume()->revision();
  const EditOutcome outcome = Filter();
  EXPECT_EQ(outcome.volume_revision, revision + 1);
  EXPECT_EQ(outcome.undo_steps, 1u);
  EXPECT_GT(outcome.changed_voxels, 1000u);
  EXPECT_TRUE(outcome.changed.has_value());
  EXPECT_NE(Hash(), before);
  CheckFiltered(outcome);
  EXPECT_EQ(editor_->Undo().undo_steps, 0u);
  EXPECT_EQ(Hash(), before);
}

TEST_F(VolumeFiltererTest, AFilterThatChangesNothingIsNoStep) {
  editor_->Edit({.shape = BoxShape{Vec3(0, 0, 0), Vec3(71, 71, 71)}, .value = 0.0});
  const std::uint64_t revision = Volume()->revision();
  const EditOutcome outcome = Filter();
  EXPECT_EQ(outcome.changed_voxels, 0u);
  EXPECT_EQ(outcome.volume_revision, revision);
  EXPECT_EQ(outcome.undo_steps, 1u);
}

TEST_F(VolumeFiltererTest, ProgressRisesToTheEnd) {
  std::vector<double> fractions;
  Filter([&](std::string_view stage, double fraction) {
    EXPECT_EQ(stage, "filtering");
    fractions.push_back(fraction);
  });
  ASSERT_GE(fractions.size(), 3u);
  EXPECT_TRUE(std::is_sorted(fractions.begin(), fractions.end()));
  EXPECT_EQ(fractions.front(), 0.0);
  EXPECT_LE(fractions.back(), 1.0);
}

TEST_F(VolumeFiltererTest, EditsMeanwhileAreFilteredToo) {
  for (const FilterKind kind : {FilterKind::kGaussian, FilterKind::kMean, FilterKind::kMedian}) {
    filter_ = {.kind = kind, .region = BoxShape{Vec3(5, 5, 5), Vec3(70, 69, 68)}};
    int n = 0;
    const EditOutcome outcome = Filter([&](std::string_view, double) {
      Dig(10.0 + 13 * n % 60, 20 + 7 * n % 45, 64);
      ++n;
    });
    EXPECT_GT(n, 2);
    CheckFiltered(outcome);
  }
}

TEST_F(VolumeFiltererTest, AnEditThatIsUndoneMeanwhileLeavesNoTrace) {
  const ContentHash plain =
      loaded_->bricks().With(ApplyFilter(loaded_, filter_).changes, 9999).content_hash();
  Dig(30, 30, 30);
  int n = 0;
  const EditOutcome outcome = Filter([&](std::string_view, double) {
    if (n++ == 1) editor_->Undo();
  });
  EXPECT_EQ(Hash(), plain);
  EXPECT_EQ(outcome.undo_steps, 1u);
  CheckFiltered(outcome);
}

// Whoever changes everything all the time has to wait in the end, and is not lost.
TEST_F(VolumeFiltererTest, EditorsThatNeverPauseAreFilteredToo) {
  filter_ = {.kind = FilterKind::kGaussian};
  std::atomic<bool> stop{false};
  std::atomic<std::uint64_t> edits{0};
  std::vector<std::thread> editors;
  for (unsigned t = 0; t < 4; ++t) {
    editors.emplace_back([&, t] {
      std::mt19937 random(t);
      while (!stop) edits += DigSomewhere(random).changed_voxels > 0;
    });
  }
  EditOutcome outcome;
  for (int n = 0; n < 3; ++n) {
    outcome = Filter();
    EXPECT_EQ(outcome.undo_steps, outcome.volume_revision - loaded_->revision());
  }
  stop = true;
  for (std::thread& editor : editors) editor.join();
  // Every edit and every filter is one revision; none got lost.
  EXPECT_EQ(Volume()->revision(), loaded_->revision() + edits + 3);
  while (editor_->Undo().undo_steps > 0) {
  }
  EXPECT_EQ(Hash(), loaded_->bricks().content_hash());
}

TEST_F(VolumeFiltererTest, AnotherVolumeMeanwhileIsAConflict) {
  ContentHash other;
  const auto load = [&](std::string_view, double fraction) {
    if (fraction > 0.0 && other == ContentHash{}) {
      session_->Load({.source = "builtin:gyroid:40"}, kQuiet, kNever);
      other = Hash();
    }
  };
  EXPECT_EQ(Refusal([&] { Filter(load); }), ErrorKind::kConflict);
  EXPECT_EQ(Hash(), other);
  EXPECT_EQ(Refusal([&] { editor_->Undo(); }), ErrorKind::kConflict);
  // Even the same file again is another volume.
  session_->Load({.source = "builtin:bumps:72"}, kQuiet, kNever);
  other = {};
  EXPECT_EQ(Refusal([&] {
              Filter([&](std::string_view, double fraction) {
                if (fraction > 0.0) session_->Load({.source = "builtin:bumps:72"}, kQuiet, kNever);
              });
            }),
            ErrorKind::kConflict);
  EXPECT_EQ(Hash(), loaded_->bricks().content_hash());
}

TEST_F(VolumeFiltererTest, CancellingLeavesEverythingAsItWas) {
  Dig(10, 10, 10);
  const std::uint64_t held = HeldSoon();
  const VolumeState before = session_->volume();
  for (const double at : {0.0, 0.3, 0.85}) {
    bool cancel = false;
    EXPECT_EQ(Refusal([&] {
                Filter([&](std::string_view, double fraction) { cancel |= fraction >= at; },
                       [&] { return cancel; });
              }),
              ErrorKind::kCancelled);
    EXPECT_EQ(session_->volume().volume, before.volume);
    EXPECT_EQ(session_->volume().scene_revision, before.scene_revision);
  }
  EXPECT_EQ(HeldSoon(), held);
  // The next one is not refused.
  CheckFiltered(Filter());
  EXPECT_EQ(editor_->Undo().undo_steps, 1u);
}

TEST_F(VolumeFiltererTest, OneAtATime) {
  int refused = 0;
  Filter([&](std::string_view, double) {
    std::thread([&] { refused += Refusal([&] { Filter(); }) == ErrorKind::kConflict; }).join();
  });
  EXPECT_GT(refused, 1);
  EXPECT_EQ(Volume()->revision(), loaded_->revision() + 1);
}

TEST_F(VolumeFiltererTest, TheExpectedRevisionIsThatOfItsBeginning) {
  const std::uint64_t revision = Volume()->revision();
  EXPECT_EQ(Refusal([&] { Filter(kQuiet, kNever, revision + 1); }), ErrorKind::kConflict);
  EXPECT_EQ(Volume()->revision(), revision);
  int n = 0;
  const EditOutcome outcome = Filter(
      [&](std::string_view, double) {
        if (n++ == 0) Dig(30, 30, 30);
      },
      kNever, revision);
  EXPECT_EQ(outcome.volume_revision, revision + 2);
  CheckFiltered(outcome);
}

TEST_F(VolumeFiltererTest, WhatDoesNotFitIntoMemoryIsRefused) {
  const std::uint64_t all = FilterRun(loaded_, filter_).MostBytes();
  EXPECT_GE(all, BrickDirectory::MemoryBytes(loaded_->size()) / 2);
  // What it works on takes memory, too.
  const MemoryClaim rest = LeaveOnly(all);
  EXPECT_EQ(Refusal([&] { Filter(); }), ErrorKind::kTooLarge);
  EXPECT_EQ(Volume(), loaded_);
  filter_.region = BoxShape{Vec3(30, 30, 60), Vec3(40, 40, 70)};
  CheckFiltered(Filter());
}

TEST_F(VolumeFiltererTest, TheBudgetHoldsWhatEditsAndFiltersMake) {
  const std::uint64_t loaded = HeldSoon();
  const std::uint64_t volume = Volume()->bricks().MemoryBytes();
  const EditOutcome outcome = Filter();
  EXPECT_GT(outcome.changed_voxels, 0u);
  // The volume that was loaded stays, so that the filter can be undone, and the new one beside it.
  EXPECT_GE(HeldSoon(), loaded + Volume()->bricks().MemoryBytes() - volume);
  const std::uint64_t filtered = HeldSoon();
  editor_->Undo();
  editor_->Redo();
  EXPECT_EQ(HeldSoon(), filtered);
  session_->Load({.source = "builtin:bumps:72"}, kQuiet, kNever);
  loaded_.reset();
  EXPECT_EQ(HeldSoon(), loaded);
}

TEST_F(VolumeFiltererTest, AnEditThatDoesNotFitIntoMemoryChangesNothing) {
  Dig(20, 20, 20);
  VolumeEdit edit{.shape = BoxShape{Vec3(0, 0, 0), Vec3(71, 71, 71)},
                  .operation = EditOperation::kAdd,
                  .value = 0.01};
  const ContentHash before = Hash();
  const std::uint64_t held = HeldSoon();
  {
    const MemoryClaim rest = LeaveOnly(100'000);
    EXPECT_EQ(Refusal([&] { editor_->Edit(edit); }), ErrorKind::kTooLarge);
    EXPECT_EQ(Hash(), before);
    EXPECT_EQ(HeldSoon(), held + rest.bytes());
    // Nothing that can be undone was given up in vain, and undoing needs no room.
    const MemoryClaim all = LeaveOnly(0);
    EXPECT_EQ(editor_->Undo().undo_steps, 0u);
    EXPECT_EQ(Hash(), loaded_->bricks().content_hash());
    EXPECT_EQ(editor_->Redo().undo_steps, 1u);
    EXPECT_EQ(Hash(), before);
  }
  EXPECT_EQ(editor_->Edit(edit).undo_steps, 2u);
}

TEST_F(VolumeFiltererTest, TheOldestStepsMakeRoomForAnEdit) {
  VolumeEdit edit{.shape = BoxShape{Vec3(0, 0, 0), Vec3(71, 71, 71)},
                  .operation = EditOperation::kAdd,
                  .value = 0.01};
  // From the second one on each step has leaves that are nobody else's.
  for (int n = 0; n < 4; ++n) editor_->Edit(edit);
  EXPECT_EQ(editor_->Edit(edit).undo_steps, 5u);
  HeldSoon();
  {
    const MemoryClaim rest = LeaveOnly(100'000);
    const EditOutcome outcome = editor_->Edit(edit);
    EXPECT_LT(outcome.undo_steps, 5u);
    EXPECT_GT(outcome.undo_steps, 1u);
    EXPECT_GT(outcome.changed_voxels, 0u);
  }
  // The volume as it was loaded can still be had.
  editor_->Revert();
  EXPECT_EQ(Hash(), loaded_->bricks().content_hash());
}

TEST_F(VolumeFiltererTest, ABadFilterChangesNothing) {
  filter_.width = 99;
  EXPECT_EQ(Refusal([&] { Filter(); }), ErrorKind::kInvalidArgument);
  filter_ = {.region = SphereShape{Vec3(999, 0, 0), 1.0}};
  EXPECT_EQ(Refusal([&] { Filter(); }), ErrorKind::kInvalidArgument);
  EXPECT_EQ(Volume(), loaded_);
}

}  // namespace
}  // namespace palpate
