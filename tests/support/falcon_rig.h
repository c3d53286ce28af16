// A Novint Falcon on an emulated USB bus, in this process, and the hand that holds it.
#pragma once

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "server/device/falcon/falcon_protocol.h"
#include "server/device/usb/usb_bus.h"
#include "tests/support/falcon_emulator.h"
#include "tests/support/falcon_stand.h"
#include "tests/support/served_device.h"
#include "tests/support/usb_testbed.h"

namespace palpate::test {

// The emulated one is homed at once.
class FalconRig : public DeviceRig {
 public:
  using Kind = UsbEvent::Kind;
  static constexpr const char *kKind = "falcon", *kOwn = "1-2";
  static constexpr const char *kOther = "1-4", *kBoth = "1-2, 1-4";
  static constexpr const char* kAbsent = "not found: plug it in";
  static constexpr double kPlaceMm = 0.1, kForceN = 0.05;

  FalconRig() { Plug(); }
  ~FalconRig() { device_.reset(); }

  // The port stands for a serial number.
  void Make(const std::string& port = "") { MakeWith({port, firmware_.file()}); }
  // It comes back at another port.
  void Plug() { bus_.Plug(port_, falcon_); }
  void Unplug() {
    bus_.Unplug(port_);
    port_ = port_ == kOwn ? "1-3" : kOwn;
  }
  void PlugOther() { bus_.Plug(kOther, other_); }
  void SetSilent(bool silent) { falcon_.SetFaults({.silent = silent}); }
  void Place(const Vec3& p_mm) {
    place_mm_ = p_mm;
    falcon_.SetPath([counts = FalconStand::At(p_mm)](int) { return counts; });
  }
  Vec3 Felt_n() {
    const std::vector<FalconCommand> forces = falcon_.Forces();
    return FalconStand::ForceOf(forces.empty() ? FalconCommand{} : forces.back(), place_mm_);
  }
  // Whether it is really gone is more than the host can know: a zero is tried.
  bool IsLetGoOf() {
    std::vector<UsbEvent> outs = falcon_.Events();
    std::erase_if(outs, [](const UsbEvent& event) {
      return event.kind != Kind::kOut && event.kind != Kind::kLateOut;
    });
    const auto last = DecodeFalconCommand(outs.back().bytes);
    return last && FalconStand::IsZero(*last);
  }
  DeviceTally Tally() {
    const std::vector<FalconCommand> forces = falcon_.Forces();
    const auto pushes =
        std::ranges::count_if(forces, [](const auto& it) { return !FalconStand::IsZero(it); });
    return {.readings = device_ ? device_->health().readings : forces.size(),
            .forces = forces.size(),
            .pushes = static_cast<std::uint64_t>(pushes)};
  }
  std::uint64_t Touches() { return falcon_.Forces().size(); }
  bool IsTouched() { return falcon_.CountOf(Kind::kOpen) > 0; }
  bool IsOtherDriven() { return !other_.Forces().empty(); }
  std::vector<Hindrance> Hindrances() {
    const auto plug = [this](bool may_open) {
      bus_.Unplug(kOwn);
      bus_.Plug(kOwn, falcon_, may_open);
    };
    return {{.make = [=, this] { plug(true), MakeWith({}); },
             .told = {"falcon_firmware"},
             .comes_by_itself = false},
            {.make = [=, this] { plug(false), Make(); },
             .undo = [=] { plug(true); },
             .told = {"70-palpate.rules", kOwn}},
            {.make = [this] { falcon_.SetFaults({.busy = true}), Make(); },
             .undo = [this] { falcon_.SetFaults({}); },
             .told = {"another program"}},
            {.make = [this] { Make("1-3"); }, .told = {"1-3"}, .comes_by_itself = false}};
  }
  bool Pushes() {
    Place(kRest);
    return device_->Serve(kPush, [&] { return (Felt_n() - kPush.force_n).norm() < kForceN; });
  }
  std::vector<std::string> wrapper() const { return bus_.wrapper(); }
  std::string config() const {
    return "kind = \"falcon\"\nfalcon_firmware = \"" + firmware_.file().string() + "\"\n";
  }
  void ExpectLetGoInOrder() {
    EXPECT_TRUE(Eventually([&] { return falcon_.CountOf(Kind::kClose) > 0; }));
    EXPECT_TRUE(IsLetGoOf());
    EXPECT_EQ(falcon_.CountOf(Kind::kRelease), falcon_.CountOf(Kind::kClaim));
    EXPECT_EQ(falcon_.CountOf(Kind::kAttachDriver), falcon_.CountOf(Kind::kDetachDriver));
    EXPECT_EQ(falcon_.firmware(), firmware_.bytes());
  }

  FalconEmulator falcon_;

 private:
  void MakeWith(const FalconOptions& options) {
    device_.reset();
    device_ = std::make_unique<ServedDevice>(
        std::make_unique<UsbBus>(std::make_unique<FalconProtocol>(options)));
  }

  const FalconFirmware firmware_{};
  FalconEmulator other_;
  UsbTestbed bus_;
  std::string port_ = kOwn;
  Vec3 place_mm_ = kRest;
};

}  // namespace palpate::test
