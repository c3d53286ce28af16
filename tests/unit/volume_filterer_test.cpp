// Filters of a session while others edit, load and cancel; without a servo.
#include "server/session/edits/volume_filterer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "server/volume/snapshot/brick_memory.h"
#include "tests/support/editable_session.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using testing::kNever;
using testing::kQuiet;
using testing::Refusal;

constexpr std::uint64_t kFilterBudgetBytes = std::uint64_t{64} << 20;

struct FilterBudget {
  const std::shared_ptr<MemoryBudget> budget_;
  VolumeLoader Loader() const {
    VolumeLoader loader;
    loader.budget = budget_;
    return loader;
  }
};

class VolumeFiltererTest : public ::testing::Test,
                           protected FilterBudget,
                           protected testing::EditableSession {
 protected:
  explicit VolumeFiltererTest(std::uint64_t budget_bytes = kFilterBudgetBytes)
      : FilterBudget{MemoryBudget::Make(budget_bytes, LiveBrickBytes)}, EditableSession(Loader()) {
    Load("builtin:bumps:72");
    loaded_ = volume();
  }

  EditOutcome Filter(const LoadProgress& progress = kQuiet, const LoadCancelled& cancelled = kNever,
                     const VolumeEditor::Revision& expected = {}) {
    return filterer_.Filter(filter_, expected, progress, cancelled);
  }

  EditOutcome Dig(double x, double y, double z, double radius = 3.0) {
    return editor_.Edit({.shape = SphereShape{Vec3(x, y, z), radius}, .value = 0.25});
  }

  // What is held once all that nobody shows is freed.
  std::uint64_t HeldSoon() {
    session().retired().WaitForFreed(std::chrono::seconds(60));
    return budget_->held_bytes();
  }
  MemoryClaim LeaveOnly(std::uint64_t bytes) {
    return budget_->Claim("a test", kFilterBudgetBytes - HeldSoon() - bytes);
  }

  // The last step is the filter of what was there before it, to the bit.
  void CheckFiltered(const EditOutcome& outcome) {
    EXPECT_EQ(volume()->revision(), outcome.volume_revision);
    const ContentHash filtered = hash();
    editor_.Undo();
    const auto before = volume();
    const EditResult expected = ApplyFilter(before, filter_);
    EXPECT_EQ(before->bricks().With(expected.changes, 9999).content_hash(), filtered);
    EXPECT_EQ(outcome.changed_voxels, expected.changed_voxels);
    editor_.Redo();
    EXPECT_EQ(hash(), filtered);
  }

  VolumeFilter filter_{.kind = FilterKind::kMean};
  const VolumeEdit everywhere_{.shape = BoxShape{Vec3(0, 0, 0), Vec3(71, 71, 71)},
                               .operation = EditOperation::kAdd,
                               .value = 0.01};
  VolumeEditor editor_{session()};
  VolumeFilterer filterer_{session(), editor_};
  std::shared_ptr<const VolumeSnapshot> loaded_;
};

TEST_F(VolumeFiltererTest, AFilterIsOneRevisionAndOneStep) {
  const ContentHash before = hash();
  const std::uint64_t revision = volume()->revision();
  const EditOutcome outcome = Filter();
  EXPECT_EQ(outcome.volume_revision, revision + 1);
  EXPECT_EQ(outcome.undo_steps, 1u);
  EXPECT_GT(outcome.changed_voxels, 1000u);
  EXPECT_TRUE(outcome.changed.has_value());
  EXPECT_NE(hash(), before);
  CheckFiltered(outcome);
  EXPECT_EQ(editor_.Undo().undo_steps, 0u);
  EXPECT_EQ(hash(), before);
}

TEST_F(VolumeFiltererTest, AFilterThatChangesNothingIsNoStep) {
  editor_.Edit({.shape = BoxShape{Vec3(0, 0, 0), Vec3(71, 71, 71)}, .value = 0.0});
  const std::uint64_t revision = volume()->revision();
  const EditOutcome outcome = Filter();
  EXPECT_EQ(outcome.changed_voxels, 0u);
  EXPECT_EQ(outcome.volume_revision, revision);
  EXPECT_EQ(outcome.undo_steps, 1u);
}

TEST_F(VolumeFiltererTest, ProgressRisesToTheEnd) {
  filter_.spacing_mm = Vec3::Constant(1.5);
  for (const FilterKind kind : {FilterKind::kMean, FilterKind::kResample}) {
    filter_.kind = kind;
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
}

TEST_F(VolumeFiltererTest, EditsMeanwhileAreFilteredToo) {
  filter_ = {.kind = FilterKind::kGaussian, .region = BoxShape{Vec3(5, 5, 5), Vec3(70, 69, 68)}};
  int n = 0;
  const EditOutcome outcome = Filter([&](std::string_view, double) {
    Dig(10.0 + 13 * n % 60, 20 + 7 * n % 45, 64);
    ++n;
  });
  EXPECT_GT(n, 2);
  CheckFiltered(outcome);
}

TEST_F(VolumeFiltererTest, AnEditThatIsUndoneMeanwhileLeavesNoTrace) {
  const ContentHash plain =
      loaded_->bricks().With(ApplyFilter(loaded_, filter_).changes, 9999).content_hash();
  Dig(30, 30, 30);
  int n = 0;
  const EditOutcome outcome = Filter([&](std::string_view, double) {
    if (n++ == 1) editor_.Undo();
  });
  EXPECT_EQ(hash(), plain);
  EXPECT_EQ(outcome.undo_steps, 1u);
  CheckFiltered(outcome);
}

// The history of all edits takes more than the budget of the other tests.
class VolumeFiltererInPlenty : public VolumeFiltererTest {
 protected:
  VolumeFiltererInPlenty() : VolumeFiltererTest(std::uint64_t{4} << 30) {}
};

// Whoever changes everything all the time has to wait in the end, and is not lost.
TEST_F(VolumeFiltererInPlenty, EditorsThatNeverPauseAreFilteredToo) {
  // What they edit must fit into the history, however long the filters take.
  constexpr int kMostEdits = 1500;  // of each
  filter_ = {.kind = FilterKind::kGaussian};
  std::atomic<std::uint64_t> edits{0};
  std::vector<std::jthread> editors;
  for (unsigned t = 0; t < 4; ++t) {
    editors.emplace_back([&, t](const std::stop_token& stop) {
      std::mt19937 random(t);
      std::uniform_real_distribution<double> place(0.0, 71.0);
      for (int n = 0; n < kMostEdits && !stop.stop_requested(); ++n) {
        edits += Dig(place(random), place(random), place(random)).changed_voxels > 0;
      }
    });
  }
  EditOutcome outcome;
  for (int n = 0; n < 3; ++n) {
    outcome = Filter();
    EXPECT_EQ(outcome.undo_steps, outcome.volume_revision - loaded_->revision());
  }
  editors.clear();
  // Every edit and every filter is one revision; none got lost.
  EXPECT_EQ(volume()->revision(), loaded_->revision() + edits + 3);
  while (editor_.Undo().undo_steps > 0) {
  }
  EXPECT_EQ(hash(), loaded_->bricks().content_hash());
}

TEST_F(VolumeFiltererTest, AnotherVolumeMeanwhileIsAConflict) {
  ContentHash other;
  const auto load = [&](std::string_view, double fraction) {
    if (fraction > 0.0 && other == ContentHash{}) {
      Load("builtin:gyroid:40");
      other = hash();
    }
  };
  EXPECT_EQ(Refusal([&] { Filter(load); }), ErrorKind::kConflict);
  EXPECT_EQ(hash(), other);
  EXPECT_EQ(Refusal([&] { editor_.Undo(); }), ErrorKind::kConflict);
  // Even the same file again is another volume.
  Load("builtin:bumps:72");
  other = {};
  EXPECT_EQ(Refusal([&] {
              Filter([&](std::string_view, double fraction) {
                if (fraction > 0.0) Load("builtin:bumps:72");
              });
            }),
            ErrorKind::kConflict);
  EXPECT_EQ(hash(), loaded_->bricks().content_hash());
}

TEST_F(VolumeFiltererTest, CancellingLeavesEverythingAsItWas) {
  Dig(10, 10, 10);
  const std::uint64_t held = HeldSoon();
  const VolumeState before = session().volume();
  for (const double at : {0.0, 0.3, 0.85}) {
    bool cancel = false;
    EXPECT_EQ(Refusal([&] {
                Filter([&](std::string_view, double fraction) { cancel |= fraction >= at; },
                       [&] { return cancel; });
              }),
              ErrorKind::kCancelled);
    EXPECT_EQ(session().volume().volume, before.volume);
    EXPECT_EQ(session().volume().scene_revision, before.scene_revision);
  }
  EXPECT_EQ(HeldSoon(), held);
  // The next one is not refused.
  CheckFiltered(Filter());
  EXPECT_EQ(editor_.Undo().undo_steps, 1u);
}

TEST_F(VolumeFiltererTest, OneAtATime) {
  int refused = 0;
  Filter([&](std::string_view, double) {
    std::thread([&] { refused += Refusal([&] { Filter(); }) == ErrorKind::kConflict; }).join();
  });
  EXPECT_GT(refused, 1);
  EXPECT_EQ(volume()->revision(), loaded_->revision() + 1);
}

TEST_F(VolumeFiltererTest, TheExpectedRevisionIsThatOfItsBeginning) {
  const std::uint64_t revision = volume()->revision();
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
  EXPECT_EQ(volume(), loaded_);
  filter_.region = BoxShape{Vec3(30, 30, 60), Vec3(40, 40, 70)};
  CheckFiltered(Filter());
}

TEST_F(VolumeFiltererTest, TheBudgetHoldsWhatEditsAndFiltersMake) {
  const std::uint64_t loaded = HeldSoon();
  const std::uint64_t bytes = volume()->bricks().MemoryBytes();
  const EditOutcome outcome = Filter();
  EXPECT_GT(outcome.changed_voxels, 0u);
  // The volume that was loaded stays, so that the filter can be undone, and the new one beside it.
  EXPECT_GE(HeldSoon(), loaded + volume()->bricks().MemoryBytes() - bytes);
  const std::uint64_t filtered = HeldSoon();
  editor_.Undo();
  editor_.Redo();
  EXPECT_EQ(HeldSoon(), filtered);
  Load("builtin:bumps:72");
  loaded_.reset();
  EXPECT_EQ(HeldSoon(), loaded);
}

TEST_F(VolumeFiltererTest, AnEditThatDoesNotFitIntoMemoryChangesNothing) {
  Dig(20, 20, 20);
  const ContentHash before = hash();
  const std::uint64_t held = HeldSoon();
  {
    const MemoryClaim rest = LeaveOnly(100'000);
    EXPECT_EQ(Refusal([&] { editor_.Edit(everywhere_); }), ErrorKind::kTooLarge);
    EXPECT_EQ(hash(), before);
    EXPECT_EQ(HeldSoon(), held + rest.bytes());
    // Nothing that can be undone was given up in vain, and undoing needs no room.
    const MemoryClaim all = LeaveOnly(0);
    EXPECT_EQ(editor_.Undo().undo_steps, 0u);
    EXPECT_EQ(hash(), loaded_->bricks().content_hash());
    EXPECT_EQ(editor_.Redo().undo_steps, 1u);
    EXPECT_EQ(hash(), before);
  }
  EXPECT_EQ(editor_.Edit(everywhere_).undo_steps, 2u);
}

TEST_F(VolumeFiltererTest, TheOldestStepsMakeRoomForAnEdit) {
  // From the second one on each step has leaves that are nobody else's.
  for (int n = 0; n < 4; ++n) editor_.Edit(everywhere_);
  EXPECT_EQ(editor_.Edit(everywhere_).undo_steps, 5u);
  HeldSoon();
  {
    const MemoryClaim rest = LeaveOnly(100'000);
    const EditOutcome outcome = editor_.Edit(everywhere_);
    EXPECT_LT(outcome.undo_steps, 5u);
    EXPECT_GT(outcome.undo_steps, 1u);
    EXPECT_GT(outcome.changed_voxels, 0u);
  }
  // The volume as it was loaded can still be had.
  editor_.Revert();
  EXPECT_EQ(hash(), loaded_->bricks().content_hash());
}

class WholeVolumes : public VolumeFiltererTest {
 protected:
  WholeVolumes() { filter_ = {.kind = FilterKind::kResample, .spacing_mm = Vec3::Constant(1.5)}; }
};

TEST_F(WholeVolumes, ResamplingIsOneRevisionAndOneStep) {
  const VolumeState before = session().volume();
  const double isovalue = session().settings().settings.isovalue;
  const EditOutcome outcome = Filter();
  const VolumeState after = session().volume();
  EXPECT_EQ(outcome.volume_revision, before.volume->revision() + 1);
  EXPECT_EQ(after.volume->revision(), outcome.volume_revision);
  EXPECT_EQ(after.volume->loaded_revision(), outcome.volume_revision);
  EXPECT_EQ(after.volume->size(), Vec3i(48, 48, 48));
  EXPECT_EQ(outcome.changed->max, Vec3i(47, 47, 47));
  EXPECT_EQ(outcome.undo_steps, 1u);
  // It lies where it did, and is felt at the same isovalue.
  EXPECT_EQ(session().settings().settings.isovalue, isovalue);
  EXPECT_LT(
      (after.registration.X_DW.Apply(Vec3(1, 2, 3)) - before.registration.X_DW.Apply(Vec3(1, 2, 3)))
          .norm(),
      1e-12);
  EXPECT_LT((after.X_DI.Apply(Vec3(10, 20, 30)) - before.X_DI.Apply(Vec3(15, 30, 45))).norm(),
            1e-9);
  // And so it is after a move by nothing.
  const VolumeState moved = session().Move([&](const VolumeState& state) {
    return Apply({}, state.volume->metadata(), session().device(), state.registration);
  });
  EXPECT_LT((moved.X_DI.Apply(Vec3(1, 2, 3)) - after.X_DI.Apply(Vec3(1, 2, 3))).norm(), 1e-9);
  EXPECT_GT(session().store().unsaved_edits(), 0u);
  EXPECT_FALSE(after.volume->metadata().reloadable);
  // What was loaded is that again.
  editor_.Undo();
  EXPECT_TRUE(volume()->metadata().reloadable);
  EXPECT_EQ(session().store().unsaved_edits(), 0u);
}

TEST_F(WholeVolumes, StepsBeforeAndAfterAreTakenBackAndDoneAgain) {
  using State = std::pair<ContentHash, Vec3i>;
  const auto now = [&] { return State(hash(), volume()->size()); };
  std::vector<State> states{now()};
  const std::function<void()> steps[] = {[&] { Dig(20, 20, 20); }, [&] { Filter(); },
                                         [&] { Dig(40, 40, 40); },
                                         [&] {
                                           filter_.spacing_mm = Vec3(1.0, 0.7, 2.0);
                                           Filter();
                                         }};
  for (const auto& step : steps) {
    step();
    states.push_back(now());
  }
  for (int round = 0; round < 2; ++round) {
    for (std::size_t n = 4; n-- > 0;) {
      EXPECT_EQ(editor_.Undo().undo_steps, n);
      EXPECT_TRUE(now() == states[n]) << n;
    }
    EXPECT_EQ(Refusal([&] { editor_.Undo(); }), ErrorKind::kConflict);
    for (std::size_t n = 1; n <= 4; ++n) {
      EXPECT_EQ(editor_.Redo().undo_steps, n);
      EXPECT_TRUE(now() == states[n]) << n;
    }
    EXPECT_EQ(Refusal([&] { editor_.Redo(); }), ErrorKind::kConflict);
  }
  EXPECT_EQ(editor_.Revert().undo_steps, 5u);
  EXPECT_TRUE(now() == states[0]);
  editor_.Undo();
  EXPECT_TRUE(now() == states[4]);
  // What is edited after a step was taken back ends what could be done again.
  editor_.Undo();
  EXPECT_EQ(Dig(5, 5, 5).redo_steps, 0u);
}

TEST_F(WholeVolumes, AnEditMeanwhileIsFilteredToo) {
  int told = 0;
  Filter([&](std::string_view, double) {
    if (told++ == 0) Dig(30, 30, 30);
  });
  const ContentHash filtered = hash();
  editor_.Undo();
  const ReshapedVolume expected = Reshape(
      *volume(), filter_, [](std::uint64_t) {}, [](double) {}, kNever);
  EXPECT_EQ(filtered, expected.bricks.content_hash());
  EXPECT_EQ(testing::ValueAt(*volume(), Vec3i(30, 30, 30)), 0.25f);
}

TEST_F(WholeVolumes, EditsWithoutEndRefuseIt) {
  int told = 0;
  const auto edit = [&](std::string_view, double) { Dig(10 + told++ % 40, 30, 30); };
  EXPECT_EQ(Refusal([&] { Filter(edit); }), ErrorKind::kConflict);
  EXPECT_EQ(volume()->size(), Vec3i(72, 72, 72));
  EXPECT_GE(told, 3);
}

// Of voxels, and of whole volumes.
TEST_F(WholeVolumes, WhatIsInTheWayIsRefusedAndChangesNothing) {
  const VolumeFilter resample = filter_;
  for (const FilterKind kind : {FilterKind::kMean, FilterKind::kResample}) {
    filter_ = resample;
    filter_.kind = kind;
    EXPECT_EQ(Refusal([&] { Filter(kQuiet, kNever, loaded_->revision() + 1); }),
              ErrorKind::kConflict);
    EXPECT_EQ(Refusal([&] { Filter(kQuiet, [] { return true; }); }), ErrorKind::kCancelled);
    {
      const MemoryClaim most = LeaveOnly(1 << 16);
      EXPECT_EQ(Refusal([&] { Filter(); }), ErrorKind::kTooLarge);
    }
    filter_.width = 99;
    filter_.spacing_mm = Vec3::Zero();
    EXPECT_EQ(Refusal([&] { Filter(); }), ErrorKind::kInvalidArgument);
    EXPECT_EQ(volume(), loaded_);
  }
  filter_ = resample;
  {
    const auto loading = session().BeginLoad();
    EXPECT_EQ(Refusal([&] { Filter(); }), ErrorKind::kConflict);
  }
  EXPECT_EQ(volume(), loaded_);
  // Of a series.
  session().PublishVolume({}, loaded_->metadata(), loaded_->bricks(), 1000);
  EXPECT_EQ(Refusal([&] { Filter(); }), ErrorKind::kConflict);
  EXPECT_EQ(volume()->size(), Vec3i(72, 72, 72));
}

}  // namespace
}  // namespace palpate
