// The thread that plans for the simulated hand: a plan for every surface, and no other.
#include "server/app/hand_guide.h"

#include <gtest/gtest.h>

#include <functional>
#include <memory>

#include "server/device/simulated_device.h"
#include "tests/support/patience.h"

namespace palpate {
namespace {

class HandGuideTest : public ::testing::Test {
 protected:
  HandGuideTest() : session_(device_, inbox_, pump_, VolumeLoader{}), guide_(session_, plans_) {}

  void Load(const char* source, double isovalue = 0.5) {
    LoadRequest request;
    request.source = source;
    request.normalized_isovalue = isovalue;
    session_.Load(
        request, [](std::string_view, double) {}, [] { return false; });
  }
  void MoveUp(double mm) {
    session_.Move([mm](const VolumeState& now) {
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

  DeviceSpec device_ = SimulatedDeviceSpec();
  SceneInbox inbox_;
  std::unique_ptr<TickOutbox> outbox_ = std::make_unique<TickOutbox>();
  Pump pump_{*outbox_};
  Session session_;
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
  plan = Next([&] { Load("builtin:bumps:32", 1.0); });
  ASSERT_NE(plan, nullptr);
  EXPECT_TRUE(plan->strokes.empty());
}

TEST_F(HandGuideTest, MakesNoPlanForWhatChangesNoSurface) {
  Load("builtin:sphere:32");
  ASSERT_NE(Next([&] { guide_.Start(); }), nullptr);
  // Stopped, it holds the volume that it would plan on.
  guide_.Stop();
  const auto holders = [&] {
    inbox_.Acquire();
    inbox_.Collect();
    return session_.volume().volume.use_count();
  };
  const long before = holders();
  session_.SetForcesOff(true);
  session_.SetForcesOff(false);
  EXPECT_EQ(holders(), before);
  MoveUp(7.0);
  EXPECT_EQ(holders(), before + 1);
}

// The hand keeps no volume: the last one that does frees it.
TEST_F(HandGuideTest, LetsAVolumeGoOnceItIsPlanned) {
  Load("builtin:sphere:32");
  const std::weak_ptr<const VolumeSnapshot> volume = session_.volume().volume;
  ASSERT_NE(Next([&] { guide_.Start(); }), nullptr);
  Load("builtin:bumps:32");
  inbox_.Acquire();
  inbox_.Collect();
  EXPECT_TRUE(test::Eventually([&] { return volume.expired(); }));
}

}  // namespace
}  // namespace palpate
