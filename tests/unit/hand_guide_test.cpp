// The thread that plans for the simulated hand: a plan for every surface, and no other.
#include "server/app/hand_guide.h"

#include <gtest/gtest.h>

#include <functional>
#include <memory>

#include "tests/support/editable_session.h"
#include "tests/support/patience.h"

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

// The hand keeps no volume: the last one that does frees it.
TEST_F(HandGuideTest, LetsAVolumeGoOnceItIsPlanned) {
  Load("builtin:sphere:32");
  const std::weak_ptr<const VolumeSnapshot> before = volume();
  ASSERT_NE(Next([&] { guide_.Start(); }), nullptr);
  Load("builtin:bumps:32");
  inbox().Acquire();
  inbox().Collect();
  EXPECT_TRUE(test::Eventually([&] { return before.expired(); }));
}

}  // namespace
}  // namespace palpate
