// The thread that plans for the simulated hand: a plan for every surface, and no other.
#include "server/app/hand_guide.h"

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <thread>

#include "server/guide/surface_probe.h"
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
      Registration moved = now.registration;
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

TEST_F(HandGuideTest, TheHandMakesRoomBeforeAnotherVolumeIsFelt) {
  Load("builtin:sphere:32");
  session().SetBeforeOtherVolume(
      [this](const HapticSurface& surface) { guide_.MakeRoomFor(surface); });
  ASSERT_NE(Next([&] { guide_.Start(); }), nullptr);
  const std::uint64_t felt = volume()->loaded_revision();
  std::thread loads([this] { Load("builtin:bumps:32"); });
  const TouchPlan* room = nullptr;
  EXPECT_TRUE(test::Eventually([&] {
    room = plans_.Acquire();
    return room != nullptr && room->makes_room;
  }));
  EXPECT_EQ(volume()->loaded_revision(), felt);
  const Scene& before = *inbox().Acquire();
  SurfaceProbe probe(before.surface);  // in the same place as the other
  for (const Vec3& p_mm : room->p_DFree_mm) EXPECT_FALSE(probe.IsMaterial(p_mm));
  plans_.is_out.store(true);
  loads.join();
  EXPECT_NE(volume()->loaded_revision(), felt);
  EXPECT_TRUE(test::Eventually([&] { return !plans_.Acquire()->makes_room; }));
  EXPECT_FALSE(plans_.Acquire()->strokes.empty());
}

// Nobody waits for long for a hand that does not come, or for a plan of another volume.
TEST_F(HandGuideTest, AnotherVolumeWaitsForNobody) {
  Load("builtin:sphere:32");
  session().SetBeforeOtherVolume(
      [this](const HapticSurface& surface) { guide_.MakeRoomFor(surface); });
  Load("builtin:bumps:32");  // without a thread, without a wait
  ASSERT_NE(Next([&] { guide_.Start(); }), nullptr);
  Load("builtin:sphere:32");  // no hand answers
  EXPECT_EQ(volume()->metadata().source, "builtin:sphere:32");
  // A volume that is refused moves nothing.
  const TouchPlan* const before = plans_.Acquire();
  EXPECT_EQ(testing::Refusal([&] {
              session().Load({.source = "builtin:bumps:32", .isovalue = 9.0}, testing::kQuiet,
                             testing::kNever);
            }),
            ErrorKind::kInvalidArgument);
  EXPECT_EQ(plans_.Acquire(), before);
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
