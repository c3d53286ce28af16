// Edits of a session: revisions, the history, and what ends it.
#include "server/session/edits/volume_editor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "server/volume/snapshot/brick_memory.h"
#include "tests/support/made_volume.h"
#include "tests/support/refusal.h"
#include "tests/support/running_session.h"

namespace palpate {
namespace {

using testing::Refusal;

// The servo runs where a test starts it.
class VolumeEditorTest : public ::testing::Test, protected testing::RunningSession {
 protected:
  void SetUp() override { Load("builtin:sphere:40"); }

  VolumeEdit RandomEdit() {
    const auto uniform = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random_);
    };
    VolumeEdit edit;
    edit.shape = SphereShape{Vec3(uniform(0, 39), uniform(0, 39), uniform(0, 39)), uniform(1, 6)};
    edit.operation = static_cast<EditOperation>(1 + random_() % 5);
    edit.value = uniform(0.1, 0.9);
    edit.falloff = uniform(0, 4);
    return edit;
  }
  // Sets one voxel of a brick to a value that it does not have.
  VolumeEdit Touch(int brick, double value) const {
    const Vec3 p(8 * (brick / 25) + 3, 8 * (brick / 5 % 5) + 3, 8 * (brick % 5) + 3);
    return {.shape = BoxShape{p, p}, .value = value};
  }

  std::mt19937 random_{17};
  VolumeEditor editor_{session()};
};

TEST_F(VolumeEditorTest, AnEditIsFeltAtATick) {
  Start();
  const std::uint64_t before = volume()->revision();
  const EditOutcome outcome =
      editor_.Edit({.shape = SphereShape{Vec3(20, 20, 20), 5.0}, .operation = EditOperation::kSet});
  EXPECT_EQ(outcome.volume_revision, before + 1);
  EXPECT_EQ(outcome.volume_revision, volume()->revision());
  EXPECT_EQ(outcome.changed_voxels, 515u);
  EXPECT_EQ(outcome.changed->min, Vec3(15, 15, 15).cast<int>());
  EXPECT_EQ(outcome.changed->max, Vec3(25, 25, 25).cast<int>());
  EXPECT_EQ(outcome.undo_steps, 1u);
  EXPECT_EQ(outcome.redo_steps, 0u);
  const AppliedTick first = editor_.Wait(outcome);
  const AppliedTick second = editor_.Wait(editor_.Undo());
  EXPECT_GT(second.tick, first.tick);
}

TEST_F(VolumeEditorTest, RandomSequencesGoBackAndForthByteForByte) {
  std::vector<ContentHash> states{hash()};
  std::size_t now = 0;
  for (int n = 0; n < 400; ++n) {
    const std::uint64_t revision = volume()->revision();
    const unsigned what = random_() % 5;
    EditOutcome outcome;
    if (what == 0 && now > 0) {
      outcome = editor_.Undo();
      --now;
    } else if (what == 1 && now + 1 < states.size()) {
      outcome = editor_.Redo();
      ++now;
    } else {
      const bool reverts = what == 2 && n % 7 == 0;
      outcome = reverts ? editor_.Revert() : editor_.Edit(RandomEdit());
      ASSERT_TRUE(!reverts || hash() == states[0]);
      if (outcome.changed_voxels == 0) {
        ASSERT_EQ(outcome.volume_revision, revision);
        continue;
      }
      states.resize(++now);
      states.push_back(hash());
    }
    ASSERT_EQ(hash(), states[now]);
    ASSERT_EQ(outcome.volume_revision, revision + 1);
    ASSERT_EQ(outcome.undo_steps, now);
    ASSERT_EQ(outcome.redo_steps, states.size() - 1 - now);
    ASSERT_GT(outcome.changed_voxels, 0u);
  }
  while (now > 0) {
    editor_.Undo();
    ASSERT_EQ(hash(), states[--now]);
  }
  while (now + 1 < states.size()) {
    editor_.Redo();
    ASSERT_EQ(hash(), states[++now]);
  }
  EXPECT_EQ(Refusal([&] { editor_.Redo(); }), ErrorKind::kConflict);
}

// 264³ voxels are more than an edit may visit at once.
TEST_F(VolumeEditorTest, ALargeEditIsOneStepWithProgressAndCanBeCancelled) {
  const LeafPtr zero = Leaf::Constant(LeafType::kFloat, 0.0f);
  VolumeMetadata metadata;
  metadata.size = Vec3i::Constant(264);
  session().PublishVolume({.source = "made"}, metadata,
                          BrickDirectory(metadata.size, [&](const Vec3i&) { return zero; }));
  const VolumeEdit edit{.shape = BoxShape{Vec3(0, 0, 0), Vec3(263, 263, 263)}, .value = 1.0};
  const std::uint64_t before = volume()->revision();
  double told = 0.0;
  const auto progress = [&](std::string_view, double share) {
    EXPECT_GT(share, told);
    told = share;
  };
  EXPECT_EQ(Refusal([&] {
              editor_.Edit(
                  edit, {}, {}, [&] { return told > 0.3; }, progress);
            }),
            ErrorKind::kCancelled);
  EXPECT_EQ(volume()->revision(), before);
  told = 0.0;
  const EditOutcome outcome = editor_.Edit(edit, {}, {}, {}, progress);
  EXPECT_EQ(outcome.volume_revision, before + 1);
  EXPECT_EQ(outcome.changed_voxels, std::uint64_t{264} * 264 * 264);
  EXPECT_EQ(outcome.undo_steps, 1u);
}

TEST_F(VolumeEditorTest, AnEditThatChangesNothingIsNoStepAndKeepsWhatCanBeRedone) {
  Start();
  editor_.Edit(Touch(3, 0.75));
  editor_.Undo();
  const VolumeState before = session().volume();
  const float stored = before.volume->bricks().Find(3, 3, 27)[VoxelInBrick(3, 3, 27)];
  const EditOutcome outcome = editor_.Edit(Touch(3, stored));
  EXPECT_EQ(outcome.changed_voxels, 0u);
  EXPECT_FALSE(outcome.changed.has_value());
  EXPECT_EQ(outcome.redo_steps, 1u);
  EXPECT_EQ(session().volume().scene_revision, before.scene_revision);
  EXPECT_EQ(session().volume().volume, before.volume);
  EXPECT_EQ(outcome.scene_revision, before.scene_revision);
  editor_.Wait(outcome);
}

TEST_F(VolumeEditorTest, AnotherRevisionThanExpectedIsAConflictThatNamesTheCurrentOne) {
  const std::uint64_t revision = volume()->revision();
  editor_.Edit(Touch(0, 0.7), revision);
  editor_.Edit(Touch(1, 0.7), revision + 1);
  editor_.Undo(revision + 2);
  const ContentHash before = hash();
  const std::function<void(std::uint64_t)> calls[] = {
      [&](std::uint64_t stale) { editor_.Edit(Touch(2, 0.7), stale); },
      [&](std::uint64_t stale) { editor_.Undo(stale); },
      [&](std::uint64_t stale) { editor_.Redo(stale); },
      [&](std::uint64_t stale) { editor_.Revert(stale); }};
  for (const auto& call : calls) {
    for (const std::uint64_t stale : {revision, revision + 2, revision + 4, std::uint64_t{0}}) {
      EXPECT_EQ(Refusal([&] { call(stale); }), ErrorKind::kConflict);
    }
    try {
      call(revision);
    } catch (const Error& error) {
      const std::string current = std::to_string(revision + 3);
      EXPECT_NE(std::string(error.what()).find(current), std::string::npos);
    }
  }
  EXPECT_EQ(hash(), before);
  EXPECT_EQ(editor_.Redo(revision + 3).undo_steps, 2u);
}

TEST_F(VolumeEditorTest, EditsThatAreNotSavedAreCountedAndKept) {
  const auto unsaved = [&] { return session().volume().unsaved_edits; };
  const auto load = [&](bool discards) {
    return Refusal([&] {
      session().Load({.source = "builtin:bumps:32", .discards_edits = discards}, testing::kQuiet,
                     testing::kNever);
    });
  };
  editor_.Edit(Touch(3, 0.1));
  editor_.Edit(Touch(4, 0.1));
  EXPECT_EQ(unsaved(), 2u);
  const auto edited = volume();
  EXPECT_EQ(load(false), ErrorKind::kFailedPrecondition);
  EXPECT_EQ(volume(), edited);
  editor_.Undo();
  EXPECT_EQ(unsaved(), 3u);  // a change of what was there to save
  editor_.Undo();
  EXPECT_EQ(unsaved(), 0u);  // as loaded
  editor_.Redo();
  editor_.Redo();
  session().store().Saved(*volume());
  EXPECT_EQ(unsaved(), 0u);
  editor_.Edit(Touch(5, 0.1), {}, {7});
  editor_.Edit(Touch(6, 0.1), {}, {7});  // the same stroke
  editor_.Edit(Touch(6, 0.1));           // changes nothing
  EXPECT_EQ(unsaved(), 1u);
  session().store().Saved(*edited);  // that save began before the stroke
  EXPECT_EQ(unsaved(), 1u);
  EXPECT_EQ(load(true), std::nullopt);
  EXPECT_EQ(unsaved(), 0u);
  EXPECT_EQ(load(false), std::nullopt);
  editor_.Edit(Touch(0, 0.1));
  session().store().Saved(*edited);  // of the volume before
  EXPECT_EQ(unsaved(), 1u);
  editor_.Undo();
  EXPECT_EQ(unsaved(), 0u);
}

TEST_F(VolumeEditorTest, NothingToTakeBackIsAConflict) {
  EXPECT_EQ(Refusal([&] { editor_.Undo(); }), ErrorKind::kConflict);
  EXPECT_EQ(Refusal([&] { editor_.Redo(); }), ErrorKind::kConflict);
  const std::uint64_t revision = volume()->revision();
  EXPECT_EQ(editor_.Revert().volume_revision, revision);
  EXPECT_EQ(editor_.Revert().undo_steps, 0u);
}

TEST_F(VolumeEditorTest, ABadEditChangesNothing) {
  editor_.Edit(Touch(0, 0.7));
  editor_.Undo();
  const VolumeState before = session().volume();
  for (const SphereShape& bad :
       {SphereShape{Vec3(99, 0, 0), 3.0}, SphereShape{Vec3(9, 9, 9), 0.0}}) {
    EXPECT_EQ(Refusal([&] { editor_.Edit({.shape = bad}); }), ErrorKind::kInvalidArgument);
  }
  EXPECT_EQ(session().volume().scene_revision, before.scene_revision);
  EXPECT_EQ(editor_.Redo().undo_steps, 1u);
}

TEST_F(VolumeEditorTest, AStrokeIsOneStep) {
  editor_.Edit(Touch(0, 0.7));
  const ContentHash before = hash();
  for (int n = 0; n < 20; ++n) editor_.Edit(Touch(n % 7, 0.1 + 0.01 * n), {}, {5});
  const ContentHash stroke = hash();
  EXPECT_EQ(editor_.Edit(Touch(9, 0.3), {}, {6}).undo_steps, 3u);
  EXPECT_EQ(editor_.Edit(Touch(9, 0.4)).undo_steps, 4u);
  EXPECT_EQ(editor_.Edit(Touch(9, 0.5)).undo_steps, 5u);
  for (int n = 0; n < 3; ++n) editor_.Undo();
  EXPECT_EQ(hash(), stroke);
  EXPECT_EQ(editor_.Undo().undo_steps, 1u);
  EXPECT_EQ(hash(), before);
  EXPECT_EQ(editor_.Redo().redo_steps, 3u);
  EXPECT_EQ(hash(), stroke);
}

TEST_F(VolumeEditorTest, AStrokeThatEndsWhereItBeganIsTakenBackWithoutAChange) {
  const double was = volume()->bricks().Find(3, 3, 3)[VoxelInBrick(3, 3, 3)];
  editor_.Edit(Touch(0, 0.9), {}, {1});
  editor_.Edit(Touch(0, was), {}, {1});
  const std::uint64_t revision = volume()->revision();
  const EditOutcome outcome = editor_.Undo();
  EXPECT_EQ(outcome.changed_voxels, 0u);
  EXPECT_EQ(outcome.volume_revision, revision);
  EXPECT_EQ(outcome.undo_steps, 0u);
  EXPECT_EQ(outcome.redo_steps, 1u);
}

TEST_F(VolumeEditorTest, TheOldestStepsAreForgottenWhereMemoryIsBounded) {
  constexpr std::uint64_t kBound = 10 * 2300;  // ten leaves
  VolumeEditor bounded(session(), kBound);
  Load("builtin:sphere:40");
  const ContentHash loaded = hash();
  std::vector<ContentHash> states{loaded};
  for (int n = 0; n < 25; ++n) {
    const EditOutcome outcome = bounded.Edit(Touch(n, 0.123));
    states.push_back(hash());
    EXPECT_EQ(outcome.undo_steps, static_cast<std::size_t>(std::min(n + 1, 10)));
    EXPECT_LE(bounded.HistoryBytes(), kBound);
  }
  for (int n = 0; n < 10; ++n) {
    bounded.Undo();
    EXPECT_LE(bounded.HistoryBytes(), kBound);
    EXPECT_EQ(hash(), states[24 - n]);
  }
  EXPECT_EQ(Refusal([&] { bounded.Undo(); }), ErrorKind::kConflict);
  // A step that is larger than all that there is stays while it is the last one.
  const ContentHash before_large = hash();
  const EditOutcome large =
      bounded.Edit({.shape = BoxShape{Vec3(0, 0, 0), Vec3(39, 39, 39)}, .value = 0.5});
  EXPECT_EQ(large.undo_steps, 1u);
  EXPECT_EQ(large.redo_steps, 0u);
  EXPECT_GT(bounded.HistoryBytes(), kBound);
  bounded.Undo();
  EXPECT_EQ(hash(), before_large);
  bounded.Redo();
  EXPECT_EQ(bounded.Edit(Touch(3, 0.321)).undo_steps, 1u);
  EXPECT_LE(bounded.HistoryBytes(), kBound);
  // Forgotten steps do not matter for what was loaded.
  bounded.Revert();
  EXPECT_EQ(hash(), loaded);
}

// --- Near the memory budget

class SmallBudgetTest : public ::testing::Test {
 protected:
  static constexpr std::uint64_t kLeafBytes = 2300;  // a little more than a leaf of floats

  static VolumeLoader LoaderWith(const std::shared_ptr<MemoryBudget>& budget) {
    VolumeLoader loader;
    loader.budget = budget;
    return loader;
  }
  // As many bytes are left as `leaves` leaves take.
  MemoryClaim LeaveRoomFor(std::uint64_t leaves) {
    data_.session().retired().WaitForFreed(std::chrono::minutes(1));
    return budget_->Claim("others", budget_->left_bytes() - leaves * kLeafBytes);
  }
  EditOutcome Touch(int brick, double value) {
    const Vec3 p(8 * (brick / 25) + 3, 8 * (brick / 5 % 5) + 3, 8 * (brick % 5) + 3);
    return editor_.Edit({.shape = BoxShape{p, p}, .value = value});
  }

  std::shared_ptr<MemoryBudget> budget_ =
      MemoryBudget::Make(std::uint64_t{1} << 30, LiveBrickBytes);
  testing::EditableSession data_{LoaderWith(budget_)};
  VolumeEditor editor_{data_.session()};
};

TEST_F(SmallBudgetTest, TheOldestStepsGoWhereAnEditNeedsTheirMemory) {
  data_.Load("builtin:gyroid:40");
  std::vector<ContentHash> states{data_.hash()};
  for (int n = 0; n < 60; ++n) {
    // The second round replaces leaves that only the history keeps then.
    EXPECT_EQ(Touch(n % 30, n < 30 ? 0.4 : 0.5).undo_steps, static_cast<std::size_t>(n + 1));
    states.push_back(data_.hash());
  }
  // An edit of eight bricks, with room for two.
  const MemoryClaim others = LeaveRoomFor(2);
  const EditOutcome outcome =
      editor_.Edit({.shape = BoxShape{Vec3(0, 0, 0), Vec3(15, 15, 15)}, .value = 0.6});
  EXPECT_GT(outcome.changed_voxels, 4000u);
  EXPECT_LT(outcome.undo_steps, 61u);
  EXPECT_GT(outcome.undo_steps, 10u);
  for (std::size_t n = outcome.undo_steps; n > 0; --n) {
    editor_.Undo();
    EXPECT_EQ(data_.hash(), states.back());
    states.pop_back();
  }
}

TEST_F(SmallBudgetTest, NoStepGoesWhereAllOfThemWouldNotBeEnough) {
  data_.Load("builtin:gyroid:40");
  for (int n = 0; n < 10; ++n) Touch(n, 0.4);
  const ContentHash edited = data_.hash();
  const MemoryClaim others = LeaveRoomFor(2);
  EXPECT_EQ(Refusal([&] {
              editor_.Edit({.shape = BoxShape{Vec3(0, 0, 0), Vec3(39, 39, 39)}, .value = 0.6});
            }),
            ErrorKind::kTooLarge);
  EXPECT_EQ(data_.hash(), edited);
  for (std::size_t n = 9; n < 10; --n) EXPECT_EQ(editor_.Undo().undo_steps, n);
}

// --- What others do

// Refuses the next scene.
struct Refusing final : SceneListener {
  void OnScene(const Scene&, std::span<const BrickChange>) override {
    if (std::exchange(refuses, false)) throw Error(ErrorKind::kInternal, "no");
  }
  bool refuses = false;
};

TEST_F(VolumeEditorTest, AnEditThatIsNotPublishedIsNoStep) {
  Refusing refusing;
  const Listening listening(session(), refusing);
  editor_.Edit(Touch(0, 0.7));
  const ContentHash before = hash();
  refusing.refuses = true;
  EXPECT_EQ(Refusal([&] { editor_.Edit(Touch(1, 0.7)); }), ErrorKind::kInternal);
  refusing.refuses = true;
  EXPECT_EQ(Refusal([&] { editor_.Undo(); }), ErrorKind::kInternal);
  EXPECT_EQ(hash(), before);
  EXPECT_EQ(editor_.Edit(Touch(2, 0.7)).undo_steps, 2u);
  // The revision of an edit that was refused is another one's now.
  refusing.refuses = true;
  EXPECT_EQ(Refusal([&] { editor_.Edit(Touch(3, 0.7)); }), ErrorKind::kInternal);
  session().store().Edit([&](const auto& present) {
    return testing::PaintedBox(present->bricks(), Vec3i::Zero(), Vec3i::Ones(),
                               [] { return 0.9f; });
  });
  EXPECT_EQ(Refusal([&] { editor_.Undo(); }), ErrorKind::kConflict);
}

// As after a replay, in which viewers had other revisions.
TEST_F(VolumeEditorTest, TheHistoryStaysWhenVoxelsGetOtherRevisions) {
  const ContentHash loaded = hash();
  editor_.Edit(Touch(0, 0.7));
  editor_.Edit(Touch(1, 0.7));
  editor_.Undo();
  const auto before = volume();
  session().store().Edit([&](const auto& present) {
    VolumeChange change;
    change.renumbered = testing::Renumbered(*present, 40);
    return change;
  });
  EXPECT_EQ(volume()->revision(), 40u);
  EXPECT_EQ(volume()->bricks().ChangedSince(before->revision()), std::vector<std::uint64_t>{0});
  EXPECT_EQ(session().store().unsaved_edits(), 3u);
  EXPECT_EQ(editor_.Redo().undo_steps, 2u);
  editor_.Undo();
  EXPECT_EQ(hash(), before->bricks().content_hash());
  editor_.Revert();
  EXPECT_EQ(hash(), loaded);
}

// It waited for its turn so long that its client has gone.
TEST_F(VolumeEditorTest, WhatNobodyWaitsForIsNotTakenBack) {
  editor_.Edit(Touch(0, 0.7));
  const ContentHash edited = hash();
  const auto gone = [] { return true; };
  EXPECT_EQ(Refusal([&] { editor_.Undo({}, gone); }), ErrorKind::kCancelled);
  EXPECT_EQ(Refusal([&] { editor_.Redo({}, gone); }), ErrorKind::kCancelled);
  EXPECT_EQ(Refusal([&] { editor_.Revert({}, gone); }), ErrorKind::kCancelled);
  EXPECT_EQ(hash(), edited);
  EXPECT_EQ(editor_.Undo().redo_steps, 1u);
}

// README: 256 MiB of replaced bricks are kept for undo.
TEST_F(VolumeEditorTest, TheHistoryHoldsAQuarterOfAGigabyte) {
  // Two bricks for all places and steps, so that the steps cost no memory here.
  const LeafPtr values[] = {testing::FilledLeaf(0.25f), testing::FilledLeaf(0.75f)};
  constexpr std::size_t kSteps = 1200, kBricks = 125;
  std::size_t undo_steps = 0;
  for (std::size_t n = 0; n < kSteps; ++n) {
    const auto change = [&](const VolumeSnapshot& volume) {
      std::vector<BrickChange> changes;
      for (std::uint64_t b = 0; b < kBricks; ++b) {
        changes.push_back({volume.bricks().BrickOf(b), values[n % 2]});
      }
      return CompareBricks(volume, changes);
    };
    undo_steps = editor_.Apply(change).undo_steps;
  }
  constexpr std::uint64_t kMiB = 1 << 20;
  EXPECT_LT(undo_steps, kSteps);
  EXPECT_LE(editor_.HistoryBytes(), 256 * kMiB);
  EXPECT_GT(editor_.HistoryBytes(), 255 * kMiB);
}

TEST_F(VolumeEditorTest, AnotherVolumeEndsTheHistoryAndIsNotKept) {
  editor_.Edit(Touch(0, 0.7));
  editor_.Edit(Touch(1, 0.7));
  editor_.Undo();
  const std::weak_ptr<const VolumeSnapshot> before = volume();
  Load("builtin:sphere:32");
  EXPECT_TRUE(IsFreed(before));
  EXPECT_EQ(editor_.HistoryBytes(), 0u);
  EXPECT_EQ(Refusal([&] { editor_.Undo(); }), ErrorKind::kConflict);
  EXPECT_EQ(Refusal([&] { editor_.Redo(); }), ErrorKind::kConflict);
  const ContentHash loaded = hash();
  editor_.Edit(Touch(0, 0.7));
  editor_.Revert();
  EXPECT_EQ(hash(), loaded);
}

// As the player of a series does.
TEST_F(VolumeEditorTest, BricksOfOthersEndTheHistoryAndAreWhatRevertLeadsTo) {
  editor_.Edit(Touch(0, 0.7));
  session().store().Edit([](const auto&) {
    return std::vector<BrickChange>{{Vec3i(2, 2, 2), testing::FilledLeaf(0.25f)}};
  });
  const ContentHash frame = hash();
  EXPECT_EQ(Refusal([&] { editor_.Undo(); }), ErrorKind::kConflict);
  editor_.Edit(Touch(1, 0.7));
  editor_.Revert();
  EXPECT_EQ(hash(), frame);
}

TEST_F(VolumeEditorTest, SettingsAndRegistrationKeepTheHistory) {
  Start();
  editor_.Edit(Touch(0, 0.7));
  session().Update({.isovalue = 0.4});
  session().Move([](const VolumeState& state) { return state.registration; });
  session().SetForcesOff(true);
  session().SetForcesOff(false);
  EXPECT_EQ(editor_.Undo().redo_steps, 1u);
}

TEST_F(VolumeEditorTest, WithoutAServoTheEditIsThereButNotFelt) {
  const EditOutcome outcome = editor_.Edit(Touch(0, 0.7));
  EXPECT_EQ(Refusal([&] { editor_.Wait(outcome); }), ErrorKind::kUnavailable);
  EXPECT_EQ(volume()->revision(), outcome.volume_revision);
}

}  // namespace
}  // namespace palpate
