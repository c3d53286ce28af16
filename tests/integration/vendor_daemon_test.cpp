// A real palpated with an emulated device of Force Dimension or Haply: it pushes, is killed,
// frozen, ended, unplugged. What the device feels then is asked of the device.
// forcedimension_test.cpp and haply_test.cpp have the faults.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <string>
#include <vector>

#include "tests/support/bare_loops.h"
#include "tests/support/daemon_rig.h"
#include "tests/support/vendor_hands.h"

namespace palpate::test {
namespace vendor_daemon {

using std::chrono::milliseconds;
using Vec3 = Eigen::Vector3d;

class VendorDaemon : public DaemonRig {
 public:
  VendorDaemon() = default;
  virtual ~VendorDaemon() { daemon_.reset(); }

  virtual std::string kind() const = 0;
  virtual std::string config() const = 0;
  virtual void Place(const Vec3& p_mm) = 0;
  virtual Vec3 Felt_n() = 0;
  // Its last force was zero, and it was let go of in order.
  virtual void ExpectLetGo() = 0;
  // How often the device was read and got a force.
  virtual std::pair<double, double> ReadingsAndForces() = 0;

  void Start() { StartOn({}, "kind = \"" + kind() + "\"\n" + config()); }
  // From below the sphere upwards, slower than a hand that is too fast.
  bool Pushes() {
    for (int tries = 0; tries < 20; ++tries) {
      Place({0, -70, 0});
      if (!Eventually([&] { return Get().health().calibrated(); })) return false;
      std::this_thread::sleep_for(milliseconds(50));
      if (!Eventually([&] { return Enable(kind()) == grpc::StatusCode::OK; })) return false;
      for (double y_mm = -70; y_mm < 0; y_mm += 0.5) {
        Place({0, y_mm, 0});
        std::this_thread::sleep_for(milliseconds(5));
        if (Felt_n().y() < -0.5) return true;
      }
    }
    return false;
  }
};

class ForceDimensionDaemon final : public VendorDaemon {
 public:
  ~ForceDimensionDaemon() override { daemon_.reset(); }

  std::string kind() const override { return "forcedimension"; }
  std::string config() const override {
    return "forcedimension_library = \"" + std::string(kFakeDrd) + "\"\n" + more;
  }
  void Place(const Vec3& p_mm) override { hand_.Place(p_mm); }
  Vec3 Felt_n() override { return hand_.Felt_n(); }
  void ExpectLetGo() override {
    EXPECT_EQ(Vec3(device.force[0], device.force[1], device.force[2]), Vec3(0, 0, 0));
    EXPECT_FALSE(device.forces_enabled);
    EXPECT_EQ(device.closes, 1);
    EXPECT_EQ(device.force_off_cause, 0);  // its watchdog had nothing to do
    EXPECT_EQ(drd_.Breaches(), std::vector<std::string>{});
  }
  std::pair<double, double> ReadingsAndForces() override {
    return {device.positions_read, device.forces_set};
  }

  std::string more{};

 private:
  TemporaryFolder folder_;
  FakeDrd drd_{folder_.path()};

 public:
  FakeDrd& drd() { return drd_; }
  FakeDrdDevice& device = drd_.device();

 private:
  ForceDimensionHand hand_{device};
};

class HaplyDaemon final : public VendorDaemon {
 public:
  ~HaplyDaemon() override { daemon_.reset(); }

  std::string kind() const override { return "haply"; }
  std::string config() const override {
    return "haply_port = " + std::to_string(service.port()) +
           "\nhaply_events_port = " + std::to_string(service.events_port()) + "\n";
  }
  void Place(const Vec3& p_mm) override { hand_.Place(p_mm); }
  Vec3 Felt_n() override { return hand_.Felt_n(); }
  void ExpectLetGo() override {
    const nlohmann::json report = service.Report();
    EXPECT_EQ(report["last_force"], nlohmann::json::array({0.0, 0.0, 0.0}));
    EXPECT_EQ(report["close_code"], 1000);
    EXPECT_EQ(report["breaches"], nlohmann::json::array());
  }
  std::pair<double, double> ReadingsAndForces() override {
    const nlohmann::json counts = service.Report()["counts"];
    return {counts["replies"].get<double>(), counts["forces"].get<double>()};
  }

  HaplyService service;

 private:
  HaplyHand hand_{service};
};

template <class Rig>
class VendorDaemonTest : public ::testing::Test {
 protected:
  Rig rig_;
};
using Rigs = ::testing::Types<ForceDimensionDaemon, HaplyDaemon>;
TYPED_TEST_SUITE(VendorDaemonTest, Rigs);

TYPED_TEST(VendorDaemonTest, EndsWithoutForce) {
  this->rig_.Start();
  ASSERT_TRUE(this->rig_.Pushes());
  this->rig_.End();
  EXPECT_TRUE(this->rig_.Felt_n().isZero());
  this->rig_.ExpectLetGo();
}

// The firmware's watchdog brakes the one, and the end of its session ends the other's force.
TYPED_TEST(VendorDaemonTest, KilledItLeavesNoForceAndAfterwardsWaitsForTheOperator) {
  this->rig_.Start();
  ASSERT_TRUE(this->rig_.Pushes());
  this->rig_.Kill();
  EXPECT_TRUE(Eventually([&] { return this->rig_.Felt_n().isZero(); }));
  this->rig_.Start();
  EXPECT_TRUE(this->rig_.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  EXPECT_TRUE(this->rig_.Get().forces().state() == v1::FORCE_STATE_OFF);
  this->rig_.Place({0, -20, 0});
  std::this_thread::sleep_for(milliseconds(200));
  EXPECT_TRUE(this->rig_.Felt_n().isZero());
  EXPECT_TRUE(this->rig_.Pushes());
}

TEST(ForceDimensionDaemonTest, FrozenItIsBrakedByTheDeviceAndWaitsForTheOperator) {
  ForceDimensionDaemon rig;
  rig.Start();
  ASSERT_TRUE(rig.Pushes());
  rig.daemon().process().Signal(SIGSTOP);
  EXPECT_TRUE(Eventually([&] { return rig.device.IsWatchdogTripped(FakeDrdNowNs()); }));
  EXPECT_TRUE(rig.Felt_n().isZero());
  EXPECT_NE(rig.device.force[2], 0.0);  // the last command was a force
  rig.daemon().process().Signal(SIGCONT);
  EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_FAULT));
  std::this_thread::sleep_for(milliseconds(200));
  EXPECT_TRUE(rig.Felt_n().isZero());
  EXPECT_TRUE(rig.Pushes());
  EXPECT_EQ(rig.drd().Breaches(), std::vector<std::string>{});
}

// How long the service keeps the last force, nobody has published: it is told that nothing comes.
TEST(HaplyDaemonTest, FrozenItIsSilentAndWaitsForTheOperator) {
  HaplyDaemon rig;
  rig.Start();
  ASSERT_TRUE(rig.Pushes());
  rig.daemon().process().Signal(SIGSTOP);
  std::this_thread::sleep_for(milliseconds(300));
  const nlohmann::json report = rig.service.Report();
  EXPECT_GT(report["now_ns"].get<double>() - report["last_message_ns"].get<double>(), 100e6);
  rig.daemon().process().Signal(SIGCONT);
  EXPECT_TRUE(Eventually([&] { return rig.Felt_n().isZero(); }));
  EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_FAULT));
  std::this_thread::sleep_for(milliseconds(200));
  EXPECT_TRUE(rig.Felt_n().isZero());
  EXPECT_TRUE(rig.Pushes());
}

TEST(ForceDimensionDaemonTest, UnpluggedItIsAFaultAndWaitsForTheOperator) {
  ForceDimensionDaemon rig;
  rig.Start();
  ASSERT_TRUE(rig.Pushes());
  rig.device.present = false;
  EXPECT_TRUE(rig.WaitForForces(v1::FORCE_STATE_FAULT));
  EXPECT_EQ(rig.Get().forces().reason(), v1::FORCE_REASON_DEVICE);
  EXPECT_TRUE(rig.WaitForConnection(v1::DEVICE_CONNECTION_ABSENT));
  rig.device.present = true;
  EXPECT_TRUE(rig.WaitForConnection(v1::DEVICE_CONNECTION_STREAMING));
  std::this_thread::sleep_for(milliseconds(200));
  EXPECT_TRUE(rig.Felt_n().isZero());
  EXPECT_TRUE(rig.Pushes());
}

// Of ten seconds, the middle one counts: the machine may stop in some. Where it stops in most,
// loops without work miss ticks, too.
TYPED_TEST(VendorDaemonTest, IsReadAndAnsweredTwoThousandTimesASecond) {
  this->rig_.Start();
  ASSERT_TRUE(this->rig_.Pushes());
  std::vector<double> lost, more_than_bare, answered;
  double all = 0.0;
  for (int second = 0; second < 10; ++second) {
    const auto [readings, forces] = this->rig_.ReadingsAndForces();
    const double lost_before = static_cast<double>(this->rig_.Get().health().lost_readings());
    BareLoops bare_loops(std::chrono::microseconds(500));
    std::this_thread::sleep_for(std::chrono::seconds(1));
    bare_loops.Stop();
    const auto [readings_after, forces_after] = this->rig_.ReadingsAndForces();
    all += readings_after - readings;
    answered.push_back((forces_after - forces) / (readings_after - readings));
    lost.push_back(static_cast<double>(this->rig_.Get().health().lost_readings()) - lost_before);
    more_than_bare.push_back(lost.back() - static_cast<double>(bare_loops.most()));
  }
  std::ranges::sort(lost);
  std::ranges::sort(more_than_bare);
  std::ranges::sort(answered);
  std::printf(
      "%.0f readings in 10 s; a second lost %.0f to %.0f, %.0f to %.0f more than bare loops, and"
      " had %.4f to %.4f forces each\n",
      all, lost.front(), lost.back(), more_than_bare.front(), more_than_bare.back(),
      answered.front(), answered.back());
  EXPECT_GT(all, 18'000.0);
  EXPECT_LE(more_than_bare[5], 0.0);
  // The loops have palpated's timer. Whatever that counts, at most 0.5 % may be lost.
  EXPECT_LE(lost[5], 10.0);
  EXPECT_GE(answered[5], 0.99);
}

}  // namespace vendor_daemon
}  // namespace palpate::test
