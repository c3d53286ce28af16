// A device of Haply over an emulated service in another process, and the hand that holds it.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "server/device/haply/haply_bus.h"
#include "tests/support/haply_service.h"
#include "tests/support/served_device.h"
#include "tests/support/vendor_hands.h"

namespace palpate::test {

class HaplyRig : public DeviceRig {
 public:
  using Json = nlohmann::json;
  static constexpr const char *kKind = "haply", *kOwn = "049D";
  static constexpr const char *kOther = "0B2C", *kBoth = "049D, 0B2C";
  static constexpr bool kEndsItsForce = true;
  static constexpr int kRateHz = 2000;
  static constexpr double kMostLost = 10.0;
  static inline const Vec3 kBelow{0.0, -70.0, 0.0};

  ~HaplyRig() {
    device_.reset();
    if (!asks_too_early_) {
      EXPECT_EQ(Report()["breaches"], Json::array());
    }
  }

  void MakeWith(HaplyOptions options) {
    options.port = static_cast<std::uint16_t>(service_.port());
    options.events_port = static_cast<std::uint16_t>(service_.events_port());
    device_.reset();
    device_ = std::make_unique<ServedDevice>(std::make_unique<HaplyBus>(options));
  }
  void Make(const std::string& serial = "") { MakeWith({.serial = serial}); }
  Json Report() { return service_.Report(); }
  void Set(const Json& changes) { service_.Set(changes); }

  void Plug() { SetPlugged(true); }
  void Unplug() { SetPlugged(false); }
  void PlugOther() { Set({{"second_device", true}}); }
  // Until it is asked again.
  void SetSilent(bool silent) {
    if (silent) Set({{"drop_replies", 1}});
  }
  void Place(const Vec3& p_mm) { hand_.Place(p_mm); }
  Vec3 Felt_n() { return hand_.Felt_n(); }
  bool IsLastZero() { return Report()["last_force"] == Json::array({0.0, 0.0, 0.0}); }
  // Without its device, its session and with it the force ends.
  bool IsLetGoOf() { return is_plugged_ && Tally().pushes > 0 ? IsLastZero() : Felt_n().isZero(); }
  DeviceTally Tally() {
    const Json counts = Report()["counts"];
    return {.readings = counts["replies"], .forces = counts["forces"], .pushes = counts["pushes"]};
  }
  std::uint64_t Touches() { return Report()["counts"]["forces"]; }
  bool IsTouched() { return IsAddressed(kOwn); }
  bool IsOtherDriven() { return IsAddressed(kOther); }
  std::vector<Hindrance> Hindrances() {
    const auto state = [this](const char* name, Json wrong, Json right, const char* told) {
      return Hindrance{.make =
                           [=, this] {
                             Set({{name, wrong}}), Make();
                           },
                       .undo =
                           [=, this] {
                             Set({{name, right}});
                           },
                       .told = {told}};
    };
    const auto options = [this](const HaplyOptions& wrong, const char* told) {
      return Hindrance{
          .make = [=, this] { MakeWith(wrong); }, .told = {told}, .comes_by_itself = false};
    };
    using std::chrono::milliseconds;
    return {options({.serial = "777"}, kOwn),
            options({.grip = "777"}, "61F7"),
            options({.model = "minverse"}, "\"inverse3\""),
            state("status", {{"in_use", true}}, {{"in_use", false}}, "another program"),
            state("control_mode", "force", "idle", "another program"),
            state("refuse_upgrade", true, false, "haply_port"),
            state("no_upgrade", true, false, "no answer in time"),
            state("no_inventory", true, false, "does not answer"),
            state("inventory_text", "hello", nullptr, "is not Haply's"),
            state("close_after_inventory", true, false, "ended the"),
            {.make = [this] { service_.Restart(milliseconds(3'600'000)), Make(); },
             .undo = [this] { service_.Restart(milliseconds(0)); },
             .told = {"haply-inverse-service"}}};
  }
  std::string config() const {
    return "kind = \"haply\"\nhaply_port = " + std::to_string(service_.port()) +
           "\nhaply_events_port = " + std::to_string(service_.events_port()) + "\n";
  }
  void ExpectLetGoInOrder() {
    EXPECT_TRUE(Eventually([&] { return Report()["sessions_closed"] == 1; }));
    EXPECT_TRUE(IsLastZero());
    EXPECT_EQ(Report()["close_code"], 1000);
  }
  bool Pushes() {
    return device_->Serve(kPush, [&] { return (Felt_n() - kPush.force_n).norm() < kForceN; });
  }

  HaplyService service_;
  HaplyHand hand_{service_};
  bool asks_too_early_ = false;  // an answer that nobody asked for was taken for one

 private:
  bool IsAddressed(const std::string& id) {
    const std::string first = Report()["first_messages"].at(0);
    return first.find(id) != std::string::npos;
  }
  void SetPlugged(bool plugged) {
    Set({{"device_present", plugged}});
    is_plugged_ = plugged;
  }

  bool is_plugged_ = true;
};

}  // namespace palpate::test
