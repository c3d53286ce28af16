// The Phantom Omni on an emulated FireWire bus, in this process, and the hand that holds it.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "server/device/omni/omni_firewire.h"
#include "tests/support/firewire_testbed.h"
#include "tests/support/omni_stand.h"
#include "tests/support/served_device.h"

namespace palpate::test {

class OmniRig : public DeviceRig {
 public:
  using Kind = FirewireEvent::Kind;
  using Omni = OmniFirewireEmulator;
  static constexpr const char *kKind = "omni-firewire", *kOwn = "70427300007";
  static constexpr const char *kOther = "11129400000", *kBoth = "11129400000, 70427300007";
  static constexpr const char* kAbsent = "not found: plug it in";
  static constexpr bool kForgetsItsPlace = true;  // its encoders count anew
  static constexpr double kPlaceMm = 0.1, kForceN = 0.05;
  static inline const Vec3 kRest = OmniStand::kRest;

  ~OmniRig() {
    device_.reset();
    EXPECT_EQ(omni_.Mistakes(), (std::map<std::string, int>{}));
    EXPECT_EQ(other_.Mistakes(), (std::map<std::string, int>{}));
  }

  void Make(const std::string& serial = "", bool has_gains = true) {
    OmniFirewireOptions options{.serial = serial};
    if (has_gains) options.motor_counts_per_n_mm = OmniStand::kGains;
    device_.reset();
    device_ = std::make_unique<ServedDevice>(std::make_unique<OmniFirewireBus>(options));
  }
  void Plug() {
    bus_.Plug(omni_);
    is_plugged_ = true;
  }
  void Unplug() {
    bus_.Unplug(omni_);
    is_plugged_ = false;
  }
  void PlugOther() { bus_.Plug(other_); }
  void SetSilent(bool silent) { omni_.SetStream({.silent = silent}); }
  void Dock() { omni_.SetHand(OmniStand::Docked()); }
  // Docks until it is calibrated, and holds the stylus there.
  void Place(const Vec3& p_mm) {
    place_mm_ = p_mm;
    if (!device_) return omni_.SetHand(OmniStand::At(p_mm));
    const DeviceState& state = device_->state();
    EXPECT_TRUE(device_->Serve(Wrench{}, [&] {
      const bool calibrated = device_->status() == DeviceStatus::kOk && state.calibrated;
      omni_.SetHand(calibrated ? OmniStand::At(p_mm) : OmniStand::Docked());
      return calibrated && !state.docked && (state.p_MHip_mm - p_mm).norm() < kPlaceMm;
    })) << state.p_MHip_mm.transpose();
  }
  Vec3 Felt_n() { return OmniStand::ForceOf(omni_.ForceOnHand(), place_mm_); }
  // Whoever was pulled out hears nothing.
  bool IsLetGoOf() {
    return !is_plugged_ || omni_.Register(Omni::kControl) != Omni::kStreams ||
           (!omni_.Forces().back().force_enabled && omni_.ForceOnHand() == std::array<int, 3>{});
  }
  DeviceTally Tally() {
    const std::vector<OmniForcePacket> forces = omni_.Forces();
    const auto pushes = std::ranges::count_if(forces, [](const OmniForcePacket& force) {
      return force.force_enabled && force.motors != std::array<int, 3>{};
    });
    return {.readings = omni_.packets_sent(),
            .forces = forces.size(),
            .pushes = static_cast<std::uint64_t>(pushes),
            .lost = omni_.Counts().lost};
  }
  std::uint64_t Touches() { return omni_.CountOf(Kind::kWrite); }
  bool IsTouched() { return Touches() > 0; }
  // The unknown quadlet disturbs two devices.
  bool IsOtherDriven() { return other_.packets_sent() > 0 && other_.unknown_quadlet().empty(); }
  std::vector<Hindrance> Hindrances() {
    return {{.make = [this] { bus_.SetMayOpen(omni_, false), Make(); },
             .undo = [this] { bus_.SetMayOpen(omni_, true); },
             .told = {"70-palpate.rules"}},
            {.make = [this] { bus_.SetFaults({.taken_channels = ~std::uint64_t{0}}), Make(); },
             .undo = [this] { bus_.SetFaults({}); },
             .told = {"no free channel"}},
            {.make = [this] { bus_.SetFaults({.no_bandwidth = true}), Make(); },
             .undo = [this] { bus_.SetFaults({}); },
             .told = {"no free channel"}},
            {.make = [this] { omni_.vendor_quadlet = 0x00112233, Make(); },
             .undo = [this] { omni_.vendor_quadlet = 0x000b9900; },
             .told = {"not those of a Phantom Omni"},
             .comes_by_itself = false},
            {.make = [this] { Make("12345678901"); },
             .told = {"12345678901"},
             .comes_by_itself = false}};
  }
  std::vector<std::string> wrapper() const { return bus_.wrapper(); }
  std::string config() const {
    return "kind = \"omni-firewire\"\nmotor_counts_per_n_mm = [2.0, -3.0, 4.0]\n";
  }
  // Motors off first, then its stream.
  void ExpectLetGoInOrder() {
    const OmniForcePacket force = omni_.Forces().back();
    EXPECT_FALSE(force.force_enabled);
    EXPECT_EQ(omni_.ForceOnHand(), (std::array<int, 3>{}));
    const FirewireEvent last = EventsOf(Kind::kWrite).back();
    EXPECT_EQ(last.number, static_cast<std::int64_t>(Omni::kControl));
    EXPECT_EQ(last.bytes, Bytes{0});
    EXPECT_GE(last.time_ns, force.time_ns);
    EXPECT_TRUE(
        Eventually([&] { return omni_.CountOf(Kind::kClose) == omni_.CountOf(Kind::kOpen); }));
  }
  std::vector<FirewireEvent> EventsOf(Kind kind) const {
    std::vector<FirewireEvent> events = omni_.Events();
    std::erase_if(events, [&](const FirewireEvent& event) { return event.kind != kind; });
    return events;
  }
  // At rest. A push counts although the watchdog ends it: where the machine is busy, this servo is
  // often silent for longer than a device waits.
  bool Pushes() {
    Place(kRest);
    std::size_t seen = omni_.force_count();
    return device_->Serve(kPush, [&] {
      const std::vector<OmniForcePacket> forces = omni_.Forces(seen);
      seen += forces.size();
      return std::ranges::any_of(forces, [&](const OmniForcePacket& force) {
        const Vec3 felt_n = OmniStand::ForceOf(force.motors, place_mm_);
        return force.moved_motors && (felt_n - kPush.force_n).norm() < kForceN;
      });
    });
  }

  Omni omni_;
  Omni other_{0x80df6000};
  EmulatedFirewireDevice camera_{0x0814430001234567};
  FirewireTestbed bus_;
  std::string node_ = bus_.Plug(omni_);

 private:
  bool is_plugged_ = true;
  Vec3 place_mm_ = kRest;
};

}  // namespace palpate::test
