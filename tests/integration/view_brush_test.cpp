// Strokes of the viewer's brush, on a real daemon.
#include <gtest/gtest.h>

#include <future>
#include <numbers>

#include "client/view/palpated/brush.h"
#include "client/view/palpated/history.h"
#include "tests/support/live_view.h"
#include "tests/support/restarted_daemon.h"

namespace palpate::view {
namespace {

using namespace std::chrono_literals;
using test::BricksOf;
using test::Follow;
using test::Settle;
using Bricks = std::vector<Brick>;

std::uint64_t CountDifferent(const Bricks& a, const Bricks& b) {
  std::uint64_t different = 0;
  for (std::size_t n = 0; n < a.size(); ++n) {
    for (int v = 0; v < kBrickVoxels; ++v) different += a[n][v] != b[n][v];
  }
  return different;
}

class ViewBrush : public ::testing::Test {
 protected:
  void SetUp() override {
    daemon_.Start();
    feed_ = std::make_unique<LiveFeed>(
        client::ServerChoice{.address = {.socket_path = daemon_.socket()}});
    ASSERT_TRUE(Settle(*feed_));
    options_.operation = client::EditOperation::kSet;
    options_.value = 0.375 * feed_->volume().lattice()->value_max;
    options_.radius_mm = 3.0 * spacing_mm();
    options_.falloff_mm = 0.0;
    options_.removes = false;
    Frame();
  }
  double spacing_mm() const { return feed_->volume().lattice()->spacing_mm.x(); }
  std::uint64_t daemon_id() const {
    return feed_->volume().revision() ? feed_->volume().revision()->daemon_id : 0;
  }
  client::EditResult EditBy(client::Client& other, double x) const {
    return other.Apply({.shape = client::Sphere{Vec3(x, 10, 10), 3.0},
                        .frame = client::EditFrame::kIndex,
                        .operation = client::EditOperation::kSet,
                        .value = 0.5 * options_.value});
  }
  // As a frame of the viewer does before the rest.
  void Frame() {
    feed_->Poll();
    brush_.Follow(feed_->volume(), feed_->losses());
  }
  // Of the daemon, once all that was asked for is done.
  std::uint64_t Revision() {
    EXPECT_TRUE(Settle(*feed_));
    Frame();
    return feed_->volume().revision()->volume_revision;
  }
  Bricks Voxels() {
    EXPECT_TRUE(Settle(*feed_));
    Frame();
    return BricksOf(feed_->volume());
  }
  void MoveTo(const Vec3& p_I) {
    brush_.Stroke(options_, feed_->volume().X_DI()->Apply(p_I), feed_->volume(), feed_->commands());
  }
  // Along z, as far as the pointer gets while frames are drawn.
  void DrawLine(double x, double y) {
    for (int n = 0; n <= 30; ++n) {
      MoveTo(Vec3(x, y, 10.0 + 0.8 * n));
      Frame();
      std::this_thread::sleep_for(2ms);
    }
    brush_.End();
  }
  // As the viewer does: the history has strokes among other steps.
  void NoteStrokes() {
    for (const Brush::BegunStroke& stroke : brush_.TakeBegun()) {
      newest_ = stroke.number;
      history_.Add(
          {.name = stroke.name,
           .go = [this, number = stroke.number](
                     bool forward) { brush_.Restore(number, forward, feed_->commands(), {}); },
           .lasts = brush_.LastsOf(stroke.number)});
    }
  }
  bool CanUndo() {
    NoteStrokes();
    return !history_.undo_name().empty();
  }
  bool CanRedo() {
    NoteStrokes();
    return !history_.redo_name().empty();
  }
  bool Undo() {
    NoteStrokes();
    return history_.Undo();
  }
  bool Redo() {
    NoteStrokes();
    return history_.Redo();
  }
  void ExpectVoxels(const Bricks& expected) { EXPECT_EQ(CountDifferent(Voxels(), expected), 0u); }
  void ExpectUndoneTo(const Bricks& expected) {
    EXPECT_TRUE(Undo());
    ExpectVoxels(expected);
  }
  // Nothing else runs until it is let go.
  std::promise<void> HoldCommands() {
    std::promise<void> go;
    feed_->commands().Do("hold",
                         [wait = go.get_future().share()](client::Client&) { wait.wait(); });
    return go;
  }

  test::RestartedDaemon daemon_;
  std::unique_ptr<LiveFeed> feed_;
  Brush brush_;
  History history_;
  std::uint64_t newest_ = 0;  // the stroke that was noted last
  BrushOptions options_;
};

TEST_F(ViewBrush, AStrokeIsTakenBackByOneUndo) {
  const Bricks loaded = Voxels();
  EXPECT_FALSE(CanUndo() || CanRedo());
  DrawLine(16, 20);
  const Bricks one = Voxels();
  EXPECT_GT(CountDifferent(loaded, one), 300u);
  EXPECT_TRUE(Follow(*feed_, [&] { return feed_->volume_info()->unsaved_edits == 1; }));
  EXPECT_TRUE(CanUndo());
  DrawLine(30, 28);
  const Bricks two = Voxels();
  EXPECT_GT(CountDifferent(one, two), 300u);

  ExpectUndoneTo(one);
  EXPECT_TRUE(CanUndo() && CanRedo());
  ExpectUndoneTo(loaded);
  EXPECT_FALSE(CanUndo());
  EXPECT_FALSE(Undo());

  EXPECT_TRUE(Redo());
  ExpectVoxels(one);
  EXPECT_TRUE(Redo());
  ExpectVoxels(two);
  EXPECT_FALSE(CanRedo());
  ExpectUndoneTo(one);
  // What is drawn now takes the place of what was taken back.
  DrawLine(24, 36);
  EXPECT_TRUE(Settle(*feed_));
  EXPECT_FALSE(CanRedo());
  ExpectUndoneTo(one);
}

TEST_F(ViewBrush, ADabIsABallInTheVolumesMillimetres) {
  options_.radius_mm = 5.0 * spacing_mm();
  MoveTo(Vec3(24, 24, 24));
  brush_.End();
  const Bricks dabbed = Voxels();
  // Twice, so that no voxel has had the value before.
  options_.value = feed_->volume().lattice()->value_min;
  MoveTo(Vec3(24, 24, 24));
  brush_.End();
  const double ball = 4.0 / 3.0 * std::numbers::pi * 125.0;
  EXPECT_NEAR(static_cast<double>(CountDifferent(dabbed, Voxels())), ball, 0.1 * ball);
}

// However long they wait: short ones, because a long one would leave a curved surface.
TEST_F(ViewBrush, WaitingEditsAreMadeOneAfterTheOther) {
  const std::uint64_t before = Revision();
  const Bricks loaded = Voxels();
  std::promise<void> go = HoldCommands();
  for (int n = 0; n <= 200; ++n) MoveTo(Vec3(20, 24, 4.0 + 0.2 * n));
  brush_.End();
  go.set_value();
  // Each is a third of the radius or a step longer.
  EXPECT_GT(Revision(), before + 30);
  // From the first point to the last.
  const auto& volume = feed_->volume();
  const auto drawn = static_cast<float>(options_.value);
  for (int z = 4; z <= 44; ++z) EXPECT_EQ(volume.Value({20, 24, z}), drawn) << z;
  ExpectUndoneTo(loaded);

  // Two strokes do not become one, however long they wait.
  go = HoldCommands();
  for (int n = 0; n <= 50; ++n) MoveTo(Vec3(10, 10, 4.0 + 0.2 * n));
  brush_.End();
  for (int n = 0; n <= 50; ++n) MoveTo(Vec3(36, 36, 4.0 + 0.2 * n));
  brush_.End();
  go.set_value();
  EXPECT_TRUE(Settle(*feed_));
  EXPECT_EQ(volume.Value({10, 10, 8}), drawn);
  EXPECT_EQ(volume.Value({36, 36, 8}), drawn);
  EXPECT_NE(volume.Value({23, 23, 4}), drawn);
  EXPECT_TRUE(Undo());
  EXPECT_TRUE(Settle(*feed_));
  EXPECT_EQ(volume.Value({10, 10, 8}), drawn);
  EXPECT_NE(volume.Value({36, 36, 8}), drawn);
}

TEST_F(ViewBrush, AHandThatRestsSendsNothing) {
  MoveTo(Vec3(20, 24, 24));
  const std::uint64_t once = Revision();
  for (int n = 0; n < 100; ++n) MoveTo(Vec3(20, 24, 24.0 + 0.5 * (n % 2)));
  EXPECT_EQ(Revision(), once);
  brush_.End();
  // A stroke that changes nothing is none.
  EXPECT_TRUE(CanUndo());
  MoveTo(Vec3(20, 24, 24));
  brush_.End();
  EXPECT_EQ(Revision(), once);
  EXPECT_TRUE(Undo());
  EXPECT_GT(Revision(), once);
  EXPECT_FALSE(CanUndo());
}

TEST_F(ViewBrush, NothingOfAnotherClientIsTakenBack) {
  client::Client other({.address = {.socket_path = daemon_.socket()}});
  ASSERT_TRUE(other.WaitUntilConnected(60s));
  DrawLine(16, 20);
  EXPECT_TRUE(Settle(*feed_));
  ASSERT_TRUE(EditBy(other, 30).changed);
  const Bricks both = Voxels();
  EXPECT_TRUE(CanUndo());
  ExpectUndoneTo(both);
  EXPECT_NE(feed_->commands().problem(), "");
  EXPECT_FALSE(CanUndo() || CanRedo());

  // Found by the next stroke, which is taken back alone.
  DrawLine(16, 34);
  EXPECT_TRUE(Settle(*feed_));
  ASSERT_TRUE(EditBy(other, 38).changed);
  const Bricks before = Voxels();
  DrawLine(30, 34);
  EXPECT_GT(CountDifferent(Voxels(), before), 0u);
  ExpectUndoneTo(before);
  EXPECT_FALSE(CanUndo());
}

// For a history of all that the user does, which has strokes among other steps.
TEST_F(ViewBrush, AStrokeLastsUntilAnotherClientEdits) {
  client::Client other({.address = {.socket_path = daemon_.socket()}});
  ASSERT_TRUE(other.WaitUntilConnected(60s));
  EXPECT_TRUE(brush_.TakeBegun().empty());
  const Bricks loaded = Voxels();
  DrawLine(16, 20);
  const auto begun = brush_.TakeBegun();
  ASSERT_EQ(begun.size(), 1u);
  const std::uint64_t stroke = begun[0].number;
  const auto lasts = brush_.LastsOf(stroke);
  EXPECT_TRUE(lasts());
  EXPECT_GT(CountDifferent(Voxels(), loaded), 0u);
  EXPECT_FALSE(brush_.is_waiting());
  // The same again changes nothing: that stroke does not last.
  MoveTo(Vec3(16, 20, 20));
  brush_.End();
  const auto again = brush_.TakeBegun();
  ASSERT_EQ(again.size(), 1u);
  Voxels();
  EXPECT_FALSE(brush_.LastsOf(again[0].number)());
  EXPECT_TRUE(lasts());

  const auto by_ada = [](client::Client&) { return std::string("token ada"); };
  brush_.Restore(stroke, /*forward=*/false, feed_->commands(), by_ada);
  ExpectVoxels(loaded);
  EXPECT_TRUE(lasts());
  brush_.Restore(stroke, /*forward=*/true, feed_->commands(), by_ada);
  const Bricks redone = Voxels();
  EXPECT_GT(CountDifferent(redone, loaded), 0u);
  // Not the last stroke: nothing is taken back.
  brush_.Restore(stroke + 100, /*forward=*/false, feed_->commands(), by_ada);
  ExpectVoxels(redone);
  EXPECT_TRUE(lasts());

  ASSERT_TRUE(EditBy(other, 38).changed);
  const Bricks both = Voxels();
  brush_.Restore(stroke, /*forward=*/false, feed_->commands(), by_ada);
  ExpectVoxels(both);
  EXPECT_FALSE(lasts());
  EXPECT_NE(feed_->commands().problem().find("token ada"), std::string::npos);
}

// It counts its revisions from 1 again: they alone do not say whose edit is the last.
TEST_F(ViewBrush, OfADaemonThatWasStartedAgainNothingIsTakenBack) {
  const std::uint64_t loaded = Revision();
  MoveTo(Vec3(16, 20, 24));
  brush_.End();
  const std::uint64_t edited = Revision();
  ASSERT_EQ(edited, loaded + 1);
  EXPECT_TRUE(CanUndo());
  const std::uint64_t stroke = newest_;
  const std::uint64_t killed = daemon_id();
  const std::uint64_t losses = feed_->losses();
  daemon_.Kill();
  // A stroke meanwhile is said to have failed.
  MoveTo(Vec3(20, 20, 20));
  brush_.End();
  EXPECT_TRUE(Follow(*feed_, [&] { return !feed_->commands().busy(); }));
  EXPECT_EQ(feed_->commands().problem().rfind("brush: ", 0), 0u);
  daemon_.Start();
  client::Client other({.address = {.socket_path = daemon_.socket()}});
  ASSERT_TRUE(other.WaitUntilConnected(60s));
  ASSERT_EQ(EditBy(other, 30).volume_revision, edited);
  // Also before the volume has come again.
  ASSERT_TRUE(Follow(*feed_, [&] { return feed_->losses() > losses; }));
  Frame();
  brush_.Restore(stroke, /*forward=*/false, feed_->commands(), {});
  // Until the volume is the new daemon's, whose revisions say the same again.
  ASSERT_TRUE(Follow(*feed_, [&] { return daemon_id() != 0 && daemon_id() != killed; }));
  const Bricks of_other = Voxels();
  EXPECT_FALSE(CanUndo());
  brush_.Restore(stroke, /*forward=*/false, feed_->commands(), {});
  ExpectVoxels(of_other);
  EXPECT_NE(feed_->commands().problem(), "");
  DrawLine(16, 20);
  EXPECT_GT(CountDifferent(Voxels(), of_other), 0u);
  ExpectUndoneTo(of_other);
}

// The daemon may have done it or not: nothing that may be another's is taken back then.
TEST_F(ViewBrush, AnUndoWithoutAnAnswerEndsTheHistory) {
  DrawLine(16, 20);
  EXPECT_TRUE(Settle(*feed_));
  ASSERT_TRUE(CanUndo());
  daemon_.Hang();
  EXPECT_TRUE(Undo());
  EXPECT_TRUE(Follow(*feed_, [&] { return !feed_->commands().busy(); }));
  EXPECT_EQ(feed_->commands().problem().rfind("undo of a stroke: ", 0), 0u);
  daemon_.Continue();
  ASSERT_TRUE(Settle(*feed_));
  EXPECT_FALSE(CanUndo() || CanRedo());
}

// The pointer left the surface, or went on far behind: one stroke, with a gap.
TEST_F(ViewBrush, AGapInAStrokeIsNotDrawnAlong) {
  const Bricks loaded = Voxels();
  const auto& volume = feed_->volume();
  const auto drawn = static_cast<float>(options_.value);
  // Also while the edit before it waits.
  for (const bool waits : {false, true}) {
    std::optional<std::promise<void>> go;
    if (waits) go = HoldCommands();
    MoveTo(Vec3(10, 24, 24));
    MoveTo(Vec3(14, 24, 24));
    brush_.Lift();
    MoveTo(Vec3(36, 24, 24));
    MoveTo(Vec3(40, 24, 24));
    brush_.End();
    if (go) go->set_value();
    const Bricks all = Voxels();
    for (const int x : {10, 12, 14, 36, 38, 40}) EXPECT_EQ(volume.Value({x, 24, 24}), drawn) << x;
    for (int x = 19; x <= 31; ++x) EXPECT_NE(volume.Value({x, 24, 24}), drawn) << x;
    EXPECT_GT(CountDifferent(all, loaded), 300u);
    ExpectUndoneTo(loaded);
  }
}

}  // namespace
}  // namespace palpate::view
