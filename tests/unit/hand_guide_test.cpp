// The thread that plans for the simulated hand: a plan for every surface, and no other.
#include "server/simulated_hand/hand_guide.h"

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <thread>
#include <vector>

#include "server/simulated_hand/touch_points.h"
#include "tests/support/editable_session.h"
#include "tests/support/patience.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

class HandGuideTest : public ::testing::Test, public testing::EditableSession {
 protected:
  HandGuideTest() : guide_(session(), plans_) { inbox().ReaderRestarts(); }

  void MoveUp(double mm) {
    session().Move([mm](const VolumeState& now) {
      VolumePlace moved = now.registration;
      moved.X_DW.translation += Vec3(0.0, mm, 0.0);
      return moved;
    });
  }
  // The plan that comes after `change`.
  const TouchPlan* Next(const std::function<void()>& change) {
    const TouchPlan* const before = plans_.Acquire();
    change();
    const bool has_come = test::Eventually([&] { return plans_.Acquire() != before; });
    return has_come ? plans_.Acquire() : nullptr;
  }

  TouchPlanInbox plans_;
  HandGuide guide_;
};

TEST_F(HandGuideTest, PlansWhateverIsLoadedOrMoved) {
  Load("builtin:sphere:32");
  guide_.Stop();  // without having started
  EXPECT_EQ(plans_.Acquire(), nullptr);
  const TouchPlan* plan = Next([&] { guide_.Start(); });
  ASSERT_NE(plan, nullptr);
  ASSERT_FALSE(plan->strokes.empty());
  const Vec3 first_mm = plan->strokes[0].points[0].p_D_mm;

  plan = Next([&] { MoveUp(7.0); });
  ASSERT_NE(plan, nullptr);
  EXPECT_NEAR((plan->strokes[0].points[0].p_D_mm - first_mm - Vec3(0.0, 7.0, 0.0)).norm(), 0.0,
              1e-6);

  // Nothing is above the greatest value.
  plan = Next([&] {
    session().Load({.source = "builtin:bumps:32", .normalized_isovalue = 1.0}, testing::kQuiet,
                   testing::kNever);
  });
  ASSERT_NE(plan, nullptr);
  EXPECT_TRUE(plan->strokes.empty());
}

// The tool's ball at the tip is to touch, and the shaft to stand off.
TEST_F(HandGuideTest, PlansForATool) {
  session().SetInitial(
      {.haptics = {.tool = {.ball = {{Vec3(0, 0, 20), 3.0}, {Vec3(0, 0, 1), 5.0}}}}});
  Load("builtin:sphere:32");
  const TouchPlan* plan = Next([&] { guide_.Start(); });
  ASSERT_NE(plan, nullptr);
  EXPECT_TRUE(plan->turns_stylus);
  const auto from_middle_mm = [&] { return plan->strokes.at(0).points[0].p_D_mm.norm(); };
  const double with_ball_mm = from_middle_mm();
  plan = Next([&] {
    session().Load({.source = "builtin:sphere:32"}, testing::kQuiet, testing::kNever,
                   {.tool = HeldTool()});
  });
  ASSERT_NE(plan, nullptr);
  EXPECT_FALSE(plan->turns_stylus);
  EXPECT_NEAR(with_ball_mm - from_middle_mm(), 5.0, 1.0);
}

TEST_F(HandGuideTest, MakesNoPlanForWhatChangesNoSurface) {
  Load("builtin:sphere:32");
  ASSERT_NE(Next([&] { guide_.Start(); }), nullptr);
  // Stopped, it holds the volume that it would plan on.
  guide_.Stop();
  const auto holders = [&] {
    inbox().Acquire();
    inbox().Collect();
    return volume().use_count();
  };
  const long before = holders();
  for (const bool off : {true, false}) {
    session().SetForcesOff(off);
    EXPECT_EQ(inbox().Acquire()->forces_off, off);
  }
  EXPECT_EQ(holders(), before);
  MoveUp(7.0);
  EXPECT_EQ(holders(), before + 1);
}

class RoomTest : public HandGuideTest {
 protected:
  RoomTest() {
    Load("builtin:sphere:32");
    session().SetBeforeOtherVolume(
        [this](const HapticSurface& surface) { guide_.MakeRoomFor(surface); });
  }
  // Until the plan that the hand would follow is one of strokes.
  void AwaitStrokes() {
    ASSERT_TRUE(test::Eventually([&] {
      const TouchPlan* const plan = plans_.Acquire();
      return plan != nullptr && !plan->strokes.empty();
    }));
  }
};

TEST_F(RoomTest, TheHandGoesBeforeAnotherVolumeIsFelt) {
  guide_.Start();
  AwaitStrokes();
  const std::uint64_t felt = volume()->loaded_revision();
  std::thread loads([this] { Load("builtin:gyroid:32"); });
  std::vector<Vec3> p_DFree_mm;
  EXPECT_TRUE(test::Eventually([&] {
    const TouchPlan* const plan = plans_.Acquire();
    if (plan == nullptr || !plan->makes_room) return false;
    p_DFree_mm = plan->p_DFree_mm;
    return true;
  }));
  EXPECT_EQ(volume()->loaded_revision(), felt);
  plans_.is_out.store(true);
  loads.join();
  EXPECT_NE(volume()->loaded_revision(), felt);
  EXPECT_FALSE(p_DFree_mm.empty());
  SurfaceProbe probe(inbox().Acquire()->surface);
  for (const Vec3& p_mm : p_DFree_mm) EXPECT_FALSE(probe.IsMaterial(p_mm));
  AwaitStrokes();
}

TEST_F(RoomTest, ALoadThatIsRefusedMovesNothing) {
  guide_.Start();
  AwaitStrokes();
  const TouchPlan* const before = plans_.Acquire();
  EXPECT_EQ(testing::Refusal([&] {
              session().Load({.source = "builtin:bumps:32", .isovalue = 9.0}, testing::kQuiet,
                             testing::kNever);
            }),
            ErrorKind::kInvalidArgument);
  EXPECT_EQ(plans_.Acquire(), before);
}

// Nobody waits for a hand that is not there, or for ever for one that does not come; and the end
// of the daemon waits for neither.
TEST_F(RoomTest, NoHandKeepsAVolumeOut) {
  Load("builtin:bumps:32");  // before the start
  EXPECT_EQ(plans_.Acquire(), nullptr);
  guide_.Start();
  AwaitStrokes();
  Load("builtin:sphere:32");
  EXPECT_EQ(volume()->metadata().source, "builtin:sphere:32");
  AwaitStrokes();
  std::thread loads([this] { Load("builtin:bumps:32"); });
  EXPECT_TRUE(test::Eventually([&] { return plans_.Acquire()->makes_room; }));
  guide_.Stop();
  loads.join();
  EXPECT_EQ(volume()->metadata().source, "builtin:bumps:32");
}

// The hand keeps no volume, also if no other one comes.
TEST_F(HandGuideTest, LetsAVolumeGoOnceItIsPlanned) {
  Load("builtin:sphere:32");
  const long waiting = volume().use_count();
  ASSERT_NE(Next([&] { guide_.Start(); }), nullptr);
  EXPECT_TRUE(test::Eventually([&] { return volume().use_count() == waiting - 1; }));
}

}  // namespace
}  // namespace palpate
