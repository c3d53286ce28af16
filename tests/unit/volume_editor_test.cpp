// Edits of a session, with a running servo loop and pump, without gRPC.
#include "server/session/volume_editor.h"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <random>
#include <thread>

#include "common/error/error.h"
#include "server/device/path_script.h"
#include "server/device/simulated_device.h"
#include "server/servo/servo_loop.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using testing::Refusal;

const LoadProgress kQuiet = [](std::string_view, double) {};
const LoadCancelled kNever = [] { return false; };

class VolumeEditorTest : public ::testing::Test {
 protected:
  void SetUp() override { Start(VolumeEditor::kHistoryBytes); }
  void TearDown() override { Stop(); }

  void Start(std::uint64_t history_bytes) {
    device_ = std::make_unique<SimulatedDevice>(
        std::make_unique<PathScript>(std::vector<Vec3>{Vec3(-70, 2, 1), Vec3(70, 1, 2)}, 100.0));
    inbox_ = std::make_unique<SceneInbox>();
    outbox_ = std::make_unique<TickOutbox>();
    pump_ = std::make_unique<Pump>(*outbox_);
    session_ = std::make_unique<Session>(device_->spec(), *inbox_, *pump_, VolumeLoader{});
    editor_ = std::make_unique<VolumeEditor>(*session_, history_bytes);
    session_->Load({.source = "builtin:sphere:40"}, kQuiet, kNever);
    RealtimeOptions options;
    options.lock_memory = false;
    servo_ = std::make_unique<ServoLoop>(*device_, *inbox_, *outbox_, options, SafetyLimits{});
    pump_->Start();
    servo_->Start();
  }
  void Stop() {
    servo_->Stop();
    pump_->Stop();
  }
  // With another bound of the history.
  void Restart(std::uint64_t history_bytes) {
    Stop();
    servo_.reset();
    editor_.reset();   // before what it listens to
    session_.reset();  // before what it frees volumes out of
    Start(history_bytes);
  }

  std::shared_ptr<const VolumeSnapshot> Volume() const { return session_->volume().volume; }
  ContentHash Hash() const { return Volume()->bricks().content_hash(); }

  VolumeEdit RandomEdit() {
    const auto uniform = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random_);
    };
    VolumeEdit edit;
    edit.shape = SphereShape{Vec3(uniform(0, 39), uniform(0, 39), uniform(0, 39)), uniform(1, 6)};
    edit.operation = static_cast<EditOperation>(random_() % 5);
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
  std::unique_ptr<SceneInbox> inbox_;
  std::unique_ptr<SimulatedDevice> device_;
  std::unique_ptr<TickOutbox> outbox_;
  std::unique_ptr<Pump> pump_;
  std::unique_ptr<Session> session_;
  std::unique_ptr<VolumeEditor> editor_;
  std::unique_ptr<ServoLoop> servo_;
};

TEST_F(VolumeEditorTest, AnEditIsFeltAtATick) {
  const std::uint64_t before = Volume()->revision();
  const EditOutcome outcome = editor_->Edit(
      {.shape = SphereShape{Vec3(20, 20, 20), 5.0}, .operation = EditOperation::kSet});
  EXPECT_EQ(outcome.volume_revision, before + 1);
  EXPECT_EQ(outcome.volume_revision, Volume()->revision());
  EXPECT_EQ(outcome.changed_voxels, 515u);
  EXPECT_EQ(outcome.changed->min, Vec3(15, 15, 15).cast<int>());
  EXPECT_EQ(outcome.changed->max, Vec3(25, 25, 25).cast<int>());
  EXPECT_EQ(outcome.undo_steps, 1u);
  EXPECT_EQ(outcome.redo_steps, 0u);
  const AppliedTick first = editor_->Wait(outcome);
  const AppliedTick second = editor_->Wait(editor_->Undo());
  EXPECT_GT(second.tick, first.tick);
}

TEST_F(VolumeEditorTest, RandomSequencesGoBackAndForthByteForByte) {
  std::vector<ContentHash> states{Hash()};
  std::size_t now = 0;
  for (int n = 0; n < 400; ++n) {
    const std::uint64_t revision = Volume()->revision();
    const unsigned what = random_() % 5;
    EditOutcome outcome;
    if (what == 0 && now > 0) {
      outcome = editor_->Undo();
      --now;
    } else if (what == 1 && now + 1 < states.size()) {
      outcome = editor_->Redo();
      ++now;
    } else {
      outcome = what == 2 && n % 7 == 0 ? editor_->Revert() : editor_->Edit(RandomEdit());
      if (outcome.changed_voxels == 0) {
        ASSERT_EQ(outcome.volume_revision, revision);
        continue;
      }
      states.resize(++now);
      states.push_back(Hash());
    }
    ASSERT_EQ(Hash(), states[now]);
    ASSERT_EQ(outcome.volume_revision, revision + 1);
    ASSERT_EQ(outcome.undo_steps, now);
    ASSERT_EQ(outcome.redo_steps, states.size() - 1 - now);
    ASSERT_GT(outcome.changed_voxels, 0u);
  }
  while (now > 0) {
    editor_->Undo();
    ASSERT_EQ(Hash(), states[--now]);
  }
  while (now + 1 < states.size()) {
    editor_->Redo();
    ASSERT_EQ(Hash(), states[++now]);
  }
  EXPECT_EQ(Refusal([&] { editor_->Redo(); }), ErrorKind::kConflict);
}

TEST_F(VolumeEditorTest, AnEditThatChangesNothingIsNoStepAndKeepsWhatCanBeRedone) {
  editor_->Edit(Touch(3, 0.75));
  editor_->Undo();
  const VolumeState before = session_->volume();
  const float stored = before.volume->bricks().Find(3, 3, 27)[VoxelInBrick(3, 3, 27)];
  const EditOutcome outcome = editor_->Edit(Touch(3, stored));
  EXPECT_EQ(outcome.changed_voxels, 0u);
  EXPECT_FALSE(outcome.changed.has_value());
  EXPECT_EQ(outcome.redo_steps, 1u);
  EXPECT_EQ(session_->volume().scene_revision, before.scene_revision);
  EXPECT_EQ(session_->volume().volume, before.volume);
  EXPECT_EQ(outcome.scene_revision, before.scene_revision);
  editor_->Wait(outcome);
}

TEST_F(VolumeEditorTest, AnotherRevisionThanExpectedIsAConflictThatNamesTheCurrentOne) {
  const std::uint64_t revision = Volume()->revision();
  editor_->Edit(Touch(0, 0.7), revision);
  editor_->Edit(Touch(1, 0.7), revision + 1);
  editor_->Undo(revision + 2);
  const ContentHash before = Hash();
  const std::string current = std::to_string(revision + 3);
  const auto conflicts = [&](const std::function<void()>& call) {
    try {
      call();
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find("at revision " + current), std::string::npos);
      return error.kind() == ErrorKind::kConflict;
    }
    return false;
  };
  for (const std::uint64_t stale : {revision, revision + 2, revision + 4, std::uint64_t{0}}) {
    EXPECT_TRUE(conflicts([&] { editor_->Edit(Touch(2, 0.7), stale); }));
    EXPECT_TRUE(conflicts([&] { editor_->Undo(stale); }));
    EXPECT_TRUE(conflicts([&] { editor_->Redo(stale); }));
    EXPECT_TRUE(conflicts([&] { editor_->Revert(stale); }));
  }
  EXPECT_EQ(Hash(), before);
  EXPECT_EQ(editor_->Redo(revision + 3).undo_steps, 2u);
}

TEST_F(VolumeEditorTest, NothingToTakeBackIsAConflict) {
  EXPECT_EQ(Refusal([&] { editor_->Undo(); }), ErrorKind::kConflict);
  EXPECT_EQ(Refusal([&] { editor_->Redo(); }), ErrorKind::kConflict);
  const std::uint64_t revision = Volume()->revision();
  EXPECT_EQ(editor_->Revert().volume_revision, revision);
  EXPECT_EQ(editor_->Revert().undo_steps, 0u);
}

TEST_F(VolumeEditorTest, ABadEditChangesNothing) {
  editor_->Edit(Touch(0, 0.7));
  editor_->Undo();
  const VolumeState before = session_->volume();
  EXPECT_EQ(Refusal([&] {
              editor_->Edit({.shape = SphereShape{Vec3(99, 0, 0), 3.0}});
            }),
            ErrorKind::kInvalidArgument);
  EXPECT_EQ(Refusal([&] {
              editor_->Edit({.shape = SphereShape{Vec3(9, 9, 9), 0.0}});
            }),
            ErrorKind::kInvalidArgument);
  EXPECT_EQ(session_->volume().scene_revision, before.scene_revision);
  EXPECT_EQ(editor_->Redo().undo_steps, 1u);
}

TEST_F(VolumeEditorTest, RevertLeadsToWhatWasLoadedAndCanBeUndone) {
  const ContentHash loaded = Hash();
  for (int n = 0; n < 10; ++n) editor_->Edit(RandomEdit());
  const ContentHash edited = Hash();
  ASSERT_NE(edited, loaded);
  const EditOutcome outcome = editor_->Revert();
  EXPECT_EQ(Hash(), loaded);
  EXPECT_EQ(outcome.redo_steps, 0u);
  editor_->Undo();
  EXPECT_EQ(Hash(), edited);
  editor_->Redo();
  EXPECT_EQ(Hash(), loaded);
}

TEST_F(VolumeEditorTest, AStrokeIsOneStep) {
  editor_->Edit(Touch(0, 0.7));
  const ContentHash before = Hash();
  for (int n = 0; n < 20; ++n) editor_->Edit(Touch(n % 7, 0.1 + 0.01 * n), {}, 5);
  const ContentHash stroke = Hash();
  EXPECT_EQ(editor_->Edit(Touch(9, 0.3), {}, 6).undo_steps, 3u);
  EXPECT_EQ(editor_->Edit(Touch(9, 0.4), {}, 0).undo_steps, 4u);
  EXPECT_EQ(editor_->Edit(Touch(9, 0.5), {}, 0).undo_steps, 5u);
  for (int n = 0; n < 3; ++n) editor_->Undo();
  EXPECT_EQ(Hash(), stroke);
  EXPECT_EQ(editor_->Undo().undo_steps, 1u);
  EXPECT_EQ(Hash(), before);
  EXPECT_EQ(editor_->Redo().redo_steps, 3u);
  EXPECT_EQ(Hash(), stroke);
}

TEST_F(VolumeEditorTest, AStrokeThatEndsWhereItBeganIsTakenBackWithoutAChange) {
  const double was = Volume()->bricks().Find(3, 3, 3)[VoxelInBrick(3, 3, 3)];
  editor_->Edit(Touch(0, 0.9), {}, 1);
  editor_->Edit(Touch(0, was), {}, 1);
  const std::uint64_t revision = Volume()->revision();
  const EditOutcome outcome = editor_->Undo();
  EXPECT_EQ(outcome.changed_voxels, 0u);
  EXPECT_EQ(outcome.volume_revision, revision);
  EXPECT_EQ(outcome.undo_steps, 0u);
  EXPECT_EQ(outcome.redo_steps, 1u);
}

TEST_F(VolumeEditorTest, TheOldestStepsAreForgottenWhereMemoryIsBounded) {
  constexpr std::uint64_t kBound = 10 * 2300;  // ten leaves
  Restart(kBound);
  const ContentHash loaded = Hash();
  std::vector<ContentHash> states{loaded};
  for (int n = 0; n < 25; ++n) {
    const EditOutcome outcome = editor_->Edit(Touch(n, 0.123));
    states.push_back(Hash());
    EXPECT_EQ(outcome.undo_steps, static_cast<std::size_t>(std::min(n + 1, 10)));
    EXPECT_LE(editor_->HistoryBytes(), kBound);
  }
  for (int n = 0; n < 10; ++n) {
    editor_->Undo();
    EXPECT_LE(editor_->HistoryBytes(), kBound);
    EXPECT_EQ(Hash(), states[24 - n]);
  }
  EXPECT_EQ(Refusal([&] { editor_->Undo(); }), ErrorKind::kConflict);
  // A step that is larger than all that there is stays while it is the last one.
  const ContentHash before_large = Hash();
  const EditOutcome large =
      editor_->Edit({.shape = BoxShape{Vec3(0, 0, 0), Vec3(39, 39, 39)}, .value = 0.5});
  EXPECT_EQ(large.undo_steps, 1u);
  EXPECT_EQ(large.redo_steps, 0u);
  EXPECT_GT(editor_->HistoryBytes(), kBound);
  editor_->Undo();
  EXPECT_EQ(Hash(), before_large);
  editor_->Redo();
  EXPECT_EQ(editor_->Edit(Touch(3, 0.321)).undo_steps, 1u);
  EXPECT_LE(editor_->HistoryBytes(), kBound);
  // Forgotten steps do not matter for what was loaded.
  editor_->Revert();
  EXPECT_EQ(Hash(), loaded);
}

// It waited for its turn so long that its client has gone.
TEST_F(VolumeEditorTest, WhatNobodyWaitsForIsNotTakenBack) {
  editor_->Edit(Touch(0, 0.7));
  const ContentHash edited = Hash();
  const auto gone = [] { return true; };
  EXPECT_EQ(Refusal([&] { editor_->Undo({}, gone); }), ErrorKind::kCancelled);
  EXPECT_EQ(Refusal([&] { editor_->Redo({}, gone); }), ErrorKind::kCancelled);
  EXPECT_EQ(Refusal([&] { editor_->Revert({}, gone); }), ErrorKind::kCancelled);
  EXPECT_EQ(Hash(), edited);
  EXPECT_EQ(editor_->Undo().redo_steps, 1u);
}

// README: 256 MiB of replaced bricks are kept for undo.
TEST_F(VolumeEditorTest, TheHistoryHoldsAQuarterOfAGigabyte) {
  // Two bricks for all places and steps, so that the steps cost no memory here.
  const auto filled = [](float value) {
    Brick brick{};
    brick.fill(value);
    return Leaf::Of(LeafType::kFloat, brick);
  };
  const LeafPtr values[] = {filled(0.25f), filled(0.75f)};
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
    undo_steps = editor_->Apply(change).undo_steps;
  }
  constexpr std::uint64_t kMiB = 1 << 20;
  EXPECT_LT(undo_steps, kSteps);
  EXPECT_LE(editor_->HistoryBytes(), 256 * kMiB);
  EXPECT_GT(editor_->HistoryBytes(), 255 * kMiB);
}

TEST_F(VolumeEditorTest, AnotherVolumeEndsTheHistoryAndIsNotKept) {
  editor_->Edit(Touch(0, 0.7));
  editor_->Edit(Touch(1, 0.7));
  editor_->Undo();
  const std::weak_ptr<const VolumeSnapshot> before = Volume();
  AppliedTick applied;
  session_->LoadAndWait({.source = "builtin:sphere:32"}, kQuiet, kNever, applied);
  session_->retired().WaitForFreed(std::chrono::seconds(10));
  EXPECT_TRUE(before.expired());
  EXPECT_EQ(editor_->HistoryBytes(), 0u);
  EXPECT_EQ(Refusal([&] { editor_->Undo(); }), ErrorKind::kConflict);
  EXPECT_EQ(Refusal([&] { editor_->Redo(); }), ErrorKind::kConflict);
  const ContentHash loaded = Hash();
  editor_->Edit(Touch(0, 0.7));
  editor_->Revert();
  EXPECT_EQ(Hash(), loaded);
}

// As the player of a series does.
TEST_F(VolumeEditorTest, BricksOfOthersEndTheHistoryAndAreWhatRevertLeadsTo) {
  editor_->Edit(Touch(0, 0.7));
  session_->store().Edit([](const auto&) {
    Brick brick{};
    brick.fill(0.25f);
    return std::vector<BrickChange>{{Vec3i(2, 2, 2), Leaf::Of(LeafType::kFloat, brick)}};
  });
  const ContentHash frame = Hash();
  EXPECT_EQ(Refusal([&] { editor_->Undo(); }), ErrorKind::kConflict);
  editor_->Edit(Touch(1, 0.7));
  editor_->Revert();
  EXPECT_EQ(Hash(), frame);
}

TEST_F(VolumeEditorTest, SettingsAndRegistrationKeepTheHistory) {
  editor_->Edit(Touch(0, 0.7));
  session_->Update({.isovalue = 0.4});
  session_->Move([](const VolumeState& state) { return state.registration; });
  session_->SetForcesOff(true);
  session_->SetForcesOff(false);
  EXPECT_EQ(editor_->Undo().redo_steps, 1u);
}

TEST_F(VolumeEditorTest, ConcurrentEditorsLoseNothing) {
  // Each adds to a brick of its own; a reader sees only whole edits.
  constexpr int kThreads = 4, kEdits = 60;
  std::atomic<bool> stop{false};
  std::atomic<int> torn{0};
  editor_->Edit({.shape = BoxShape{Vec3(0, 0, 0), Vec3(39, 39, 39)}, .value = 0.0});
  std::thread reader([&] {
    std::uint64_t revision = 0;
    while (!stop) {
      const auto volume = Volume();
      if (volume->revision() < revision) ++torn;
      revision = volume->revision();
      for (int t = 0; t < kThreads; ++t) {
        const float first = volume->bricks().Find(0, 8 * t, 0)[0];
        for (int n = 0; n < kBrickVoxels; ++n) {
          if (volume->bricks().Find(0, 8 * t, 0)[n] != first) ++torn;
        }
      }
    }
  });
  std::vector<std::thread> threads;
  for (int t = 0; t < kThreads; ++t) {
    threads.emplace_back([&, t] {
      const Vec3 corner(0, 8 * t, 0);
      for (int n = 0; n < kEdits; ++n) {
        editor_->Edit({.shape = BoxShape{corner, corner + Vec3(7, 7, 7)},
                       .operation = EditOperation::kAdd,
                       .value = 1.0 / 128});
      }
    });
  }
  std::thread settings([&] {
    for (int n = 0; n < 40; ++n) session_->Update({.isovalue = 0.3 + 0.01 * n});
  });
  for (std::thread& thread : threads) thread.join();
  settings.join();
  stop = true;
  reader.join();
  EXPECT_EQ(torn, 0);
  for (int t = 0; t < kThreads; ++t) {
    EXPECT_EQ(Volume()->bricks().Find(0, 8 * t, 0)[77], kEdits / 128.0f);
  }
  for (int n = 0; n < kThreads * kEdits; ++n) editor_->Undo();
  EXPECT_EQ(Volume()->bricks().Find(0, 0, 0)[0], 0.0f);
}

TEST_F(VolumeEditorTest, WithoutAServoTheEditIsThereButNotFelt) {
  servo_->Stop();
  const EditOutcome outcome = editor_->Edit(Touch(0, 0.7));
  EXPECT_EQ(Refusal([&] { editor_->Wait(outcome); }), ErrorKind::kUnavailable);
  EXPECT_EQ(Volume()->revision(), outcome.volume_revision);
}

}  // namespace
}  // namespace palpate
