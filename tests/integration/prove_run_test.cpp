// The real `palpate device prove` and palpated, each kind on its emulation: the test does what the
// program says, as a person would. prove_test.cpp has each fault.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <atomic>
#include <fstream>
#include <functional>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>

#include "common/files/descriptor.h"
#include "tests/support/daemon.h"
#include "tests/support/falcon_rig.h"
#include "tests/support/firewire_testbed.h"
#include "tests/support/haply_rig.h"
#include "tests/support/omni_stand.h"
#include "tests/support/places.h"
#include "tests/support/touch_emulator.h"
#include "tests/support/usb_testbed.h"
#include "tests/support/vendor_hands.h"

namespace palpate::test {
namespace {

// Whatever holds the stylus.
struct Hand {
  std::function<void(const Vec3& to_mm)> move;
  std::function<void(std::uint32_t buttons)> press;
  std::uint32_t button_count = 0;
  std::function<void(const std::string& way)> point{};  // none: its orientation is not measured
  Vec3 free_mm{0, -47, 0};                              // away from the volume
};

// Within reach of a Falcon: to the right, up and towards the user.
const Vec3 kFirstMm(-20, -40, -15), kFreeMm(0, -47, 0);
const std::vector<Vec3> kPlacesMm = {{15, -40, -15}, {15, -10, -15}, {15, -10, 15}};

class ProveRun : public ::testing::Test {
 protected:
  void Start(const std::string& device, const std::vector<std::string>& wrapper = {}) {
    std::ofstream(folder_.path() / "device.toml") << "[device]\n" << device;
    daemon_ = std::make_unique<Daemon>(
        kPalpated,
        std::vector<std::string>{"--volume", "builtin:sphere:16", "--config",
                                 folder_.path() / "device.toml"},
        wrapper, std::chrono::seconds(550));
  }

  // Starts the program with a pipe for what the person types.
  void Prove(const std::vector<std::string>& options = {}) {
    const std::string number = std::to_string(++runs_);
    const std::string typed = folder_.path() / ("typed" + number);
    out_ = folder_.path() / ("proof" + number);
    ASSERT_EQ(mkfifo(typed.c_str(), 0600), 0);
    keyboard_ = Descriptor(open(typed.c_str(), O_RDWR | O_CLOEXEC));
    std::vector<std::string> command = {"/bin/sh",
                                        "-c",
                                        "exec \"$@\" < " + typed,
                                        "sh",
                                        kPalpate,
                                        "--socket",
                                        daemon_->socket(),
                                        "device",
                                        "prove",
                                        "--out",
                                        out_};
    command.insert(command.end(), options.begin(), options.end());
    palpate_ = std::make_unique<Process>(command, std::chrono::seconds(300));
  }
  // Types an answer where the program says this. Returns false if it ends before.
  bool Answer(const std::string& said, const std::string& answer = "") {
    if (!palpate_->WaitFor(said)) return false;
    const std::string line = answer + "\n";
    return write(keyboard_.get(), line.data(), line.size()) == std::ssize(line);
  }

  // Points the stylus where the program says, if it does.
  bool Point(const Hand& hand) {
    if (!hand.point) return true;
    for (const std::string way : {"away from you", "down", "to the right"}) {
      if (!palpate_->WaitFor("stylus " + way + ",")) return false;
      hand.point(way);
      if (!Answer("stylus " + way + ",")) return false;
    }
    return true;
  }
  bool Read(const Hand& hand, const std::vector<Vec3>& places_mm) {
    if (!Answer("readings  ")) return false;
    const std::vector<std::string> ways = {"to the right, hold", "up, hold", "towards you, hold"};
    for (std::size_t n = 0; n < ways.size(); ++n) {
      if (!palpate_->WaitFor(ways[n])) return false;
      hand.move(places_mm.at(n));
      if (!Answer(ways[n])) return false;
    }
    if (!Point(hand) || !palpate_->WaitFor("buttons   ")) return false;
    for (std::uint32_t n = 0; n < hand.button_count; ++n) {
      std::this_thread::sleep_for(std::chrono::milliseconds(200));
      hand.press(1u << n);
      if (!palpate_->WaitFor("button " + std::to_string(n))) return false;
      hand.press(0);
    }
    return true;
  }
  // Where the machine stood still, the program asks for a push once more.
  bool PushTo(const std::string& way) {
    const std::string begins = "push is " + way + ",", ends = "push " + way + "?";
    std::size_t begun = 0, next = std::string::npos;
    while (palpate_->WaitUntil([&](const ProcessResult& so_far) {
      next = so_far.output.find(begins, begun);
      return next != std::string::npos || so_far.output.find(ends) != std::string::npos;
    })) {
      if (next == std::string::npos) return Answer(ends, "y");
      begun = next + 1;
      if (!Answer(begins)) return false;
    }
    return false;
  }
  bool Push() {
    if (!Answer("enable    ")) return false;
    for (const std::string way :
         {"to the right", "to the left", "up", "down", "towards you", "away from you"}) {
      if (!PushTo(way)) return false;
    }
    return Answer("stop      ") && Answer("at once?", "y");
  }

  // Until the program has ended in order: a machine that stands still for some ms ends the forces,
  // and the program then says so.
  void ExpectProven(const std::string& kind, const Hand& hand,
                    const std::string& level = "force-verified") {
    ProcessResult end;
    for (int tries = 0; tries < 8 && end.exit_code != 0; ++tries) {
      hand.move(kFirstMm);
      Prove({"--forces", kind});
      if (Read(hand, kPlacesMm)) {
        hand.move(hand.free_mm);
        Push();
      }
      end = palpate_->Wait();
      if (end.exit_code != 0) std::printf("%s%s\n", end.output.c_str(), end.error.c_str());
    }
    ASSERT_EQ(end.exit_code, 0) << end.error;
    std::printf("%s\n", end.output.c_str());
    EXPECT_EQ(ProofAt("proposed_level"), level);
    EXPECT_TRUE(ProofAt("refusal").is_null());
    EXPECT_EQ(Forces(), v1::FORCE_STATE_OFF);
    EXPECT_GT(std::filesystem::file_size(out_ / "readings.csv"), 100000u);
  }
  void ExpectRefused(const std::string& step, const std::string& part) {
    const ProcessResult end = palpate_->Wait();
    std::printf("%s%s\n", end.output.c_str(), end.error.c_str());
    EXPECT_NE(end.exit_code, 0);
    EXPECT_NE(end.error.find("palpate: " + step + ": "), std::string::npos) << end.error;
    EXPECT_NE(end.error.find(part), std::string::npos) << end.error;
    EXPECT_EQ(ProofAt("ended_at"), step);
  }

  nlohmann::json ProofAt(const std::string& key) const {
    return nlohmann::json::parse(std::ifstream(out_ / "proof.json"))[key];
  }
  v1::GetDeviceResponse Get() {
    grpc::ClientContext context;
    v1::GetDeviceResponse response;
    EXPECT_TRUE(daemon_->device->GetDevice(&context, {}, &response).ok());
    return response;
  }
  v1::ForceState Forces() { return Get().forces().state(); }

  TemporaryFolder folder_;
  int runs_ = 0;
  Descriptor keyboard_;
  std::filesystem::path out_;
  std::unique_ptr<Daemon> daemon_;
  std::unique_ptr<Process> palpate_;
};

// An emulated Falcon moves by a step for each force that it gets.
class FalconHand {
 public:
  explicit FalconHand(FalconEmulator& falcon) : falcon_(falcon) {}
  void Move(const Vec3& to_mm) {
    constexpr int kSteps = 300;
    falcon_.SetPath([from_mm = at_mm_, to_mm](int step) {
      const double share = std::min(1.0, static_cast<double>(step) / kSteps);
      return FalconStand::At(from_mm + share * (to_mm - from_mm));
    });
    at_mm_ = to_mm;
    const std::size_t before = falcon_.Forces().size();
    EXPECT_TRUE(Eventually([&] { return falcon_.Forces().size() > before + 2 * kSteps; }));
  }
  Hand hand() {
    return {[this](const Vec3& to_mm) { Move(to_mm); },
            [this](std::uint32_t buttons) { falcon_.buttons = static_cast<std::uint8_t>(buttons); },
            4};
  }

 private:
  FalconEmulator& falcon_;
  Vec3 at_mm_{0.0, -47.0, 0.0};
};

class FalconProveRun : public ProveRun {
 protected:
  FalconProveRun() { Start(rig_.config(), rig_.wrapper()); }
  ~FalconProveRun() override { daemon_.reset(); }

  FalconRig rig_{};
  FalconHand hand_{rig_.falcon_};
};

TEST_F(FalconProveRun, AFalconIsProven) { ExpectProven("falcon", hand_.hand()); }

TEST_F(FalconProveRun, AMirroredAxisAndAPulledPlugAreRefused) {
  hand_.Move({15, -40, 0});
  Prove({"--forces", "falcon"});
  EXPECT_FALSE(Read(hand_.hand(), {{-15, -40, 0}}));
  ExpectRefused("axes", "x is mirrored");
  rig_.Unplug();
  Prove();
  ExpectRefused("find", "plug it in");
}

TEST_F(FalconProveRun, ASignalWhileForcesAreOnStopsThem) {
  hand_.Move(kFirstMm);
  Prove({"--forces", "falcon"});
  ASSERT_TRUE(Read(hand_.hand(), kPlacesMm));
  hand_.Move(kFreeMm);
  ASSERT_TRUE(Answer("enable    ") && Answer("push is to the right,"));
  palpate_->Signal(SIGINT);
  ExpectRefused("push", "cancelled");
  EXPECT_EQ(Forces(), v1::FORCE_STATE_STOPPED);
}

// Moves and turns as FalconHand does. The gimbal's zeros and signs are the driver's guess.
class OmniArmHand {
 public:
  explicit OmniArmHand(OmniFirewireEmulator& omni) : omni_(omni) {}
  void Move(const Vec3& to_mm) {
    constexpr int kSteps = 300;
    omni_.SetPath([=, from_mm = at_mm_, gimbal = gimbal_](int step) {
      const double share = std::min(1.0, static_cast<double>(step) / kSteps);
      OmniHand hand = OmniStand::At(from_mm + share * (to_mm - from_mm));
      hand.gimbal = gimbal;
      return hand;
    });
    at_mm_ = to_mm;
    const std::size_t before = omni_.Forces().size();
    EXPECT_TRUE(Eventually([&] { return omni_.Forces().size() > before + 2 * kSteps; }));
  }
  Hand hand() {
    return {[this](const Vec3& to_mm) { Move(to_mm); },
            [this](std::uint32_t buttons) {
              OmniHand hand = OmniStand::At(at_mm_);
              hand.pressed = buttons;
              omni_.SetHand(hand);
            },
            2,
            [this](const std::string& way) {
              gimbal_ = {0.5, 0.5, 0.5};
              if (way == "down") gimbal_[1] = 0.5 + M_PI / 2 / 5.28;
              if (way == "to the right") gimbal_[0] = 0.5 - M_PI / 2 / 5.48;
              Move(at_mm_);
            }};
  }

 private:
  OmniFirewireEmulator& omni_;
  Vec3 at_mm_ = kFreeMm;
  std::array<double, 3> gimbal_{0.5, 0.5, 0.5};
};

TEST_F(ProveRun, AnOmniOnFirewireIsProvenAndWithoutMotorFiguresUpToItsReadings) {
  OmniFirewireEmulator omni;
  FirewireTestbed bus;
  OmniArmHand hand(omni);
  bus.Plug(omni);
  const std::string kind = "kind = \"omni-firewire\"\n";
  for (const bool has_figures : {true, false}) {
    omni.SetHand(OmniStand::Docked());
    Start(kind + (has_figures ? "motor_counts_per_n_mm = [2.0, -3.0, 4.0]\n" : ""), bus.wrapper());
    EXPECT_TRUE(Eventually([&] { return Get().health().calibrated(); }));
    if (has_figures) {
      ExpectProven("omni-firewire", hand.hand());
    } else {
      hand.Move(kFirstMm);
      Prove({"--forces", "omni-firewire"});
      EXPECT_TRUE(Read(hand.hand(), kPlacesMm));
      EXPECT_EQ(palpate_->Wait().exit_code, 0);
      EXPECT_EQ(ProofAt("proposed_level"), "state-read");
    }
    daemon_.reset();
  }
  omni.SetHand(OmniStand::Docked());
  bus.SetMayOpen(omni, false);
  Start(kind, bus.wrapper());
  Prove();
  ExpectRefused("find", "70-palpate.rules");
  daemon_.reset();
}

TEST_F(ProveRun, ATouchOnUsbIsRefusedWithWhatToDo) {
  TouchEmulator touch;
  UsbTestbed bus;
  bus.Plug("1-2", touch);
  Start("kind = \"omni-usb\"\n", bus.wrapper());
  Prove();
  ExpectRefused("find", "EMULATED0001");
  daemon_.reset();
}

// The library's hand follows a file.
TEST_F(ProveRun, ATouchByTheVendorsLibraryIsProven) {
  const std::filesystem::path file = folder_.path() / "hand";
  Vec3 at_mm(0, -47, 0);
  std::uint32_t pressed = 0;
  // Where the axes of a stylus point that is held so.
  const std::map<std::string, std::string> turned = {{"away from you", "1 0 0  0 1 0  0 0 1"},
                                                     {"down", "1 0 0  0 0 -1  0 1 0"},
                                                     {"to the right", "0 0 1  0 1 0  -1 0 0"}};
  std::string way = "away from you";
  const auto put = [&] {
    std::ofstream(folder_.path() / "next") << at_mm.x() << " " << at_mm.y() << " " << at_mm.z()
                                           << " " << pressed << " " << turned.at(way);
    std::filesystem::rename(folder_.path() / "next", file);
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  };
  const Hand hand{[&](const Vec3& to_mm) {
                    const Vec3 step_mm = (to_mm - at_mm) / 50;
                    for (int n = 0; n < 50; ++n) {
                      at_mm += step_mm;
                      put();
                    }
                  },
                  [&](std::uint32_t buttons) {
                    pressed = buttons;
                    put();
                  },
                  2,
                  [&](const std::string& to) {
                    way = to;
                    put();
                  }};
  put();
  Start("kind = \"openhaptics\"\nopenhaptics_library = \"" + std::string(kFakeHd) + "\"\n",
        {"/usr/bin/env", "PALPATE_FAKE_HD_HAND=" + file.string()});
  ExpectProven("openhaptics", hand);
}

// Moves by at most 1 m/s: a faster one is no hand. `turn`: by 90 degrees about an axis of the
// vendor's, or not at all.
template <class VendorHand>
Hand Slowly(VendorHand& hand, Vec3& at_mm, std::uint32_t buttons,
            const std::function<void(const std::string& way)>& point = {}) {
  return {[&](const Vec3& to_mm) {
            const Vec3 step_mm = (to_mm - at_mm) / 50;
            for (int n = 0; n < 50; ++n) {
              at_mm += step_mm;
              hand.Place(at_mm);
              std::this_thread::sleep_for(std::chrono::milliseconds(10));
            }
          },
          [&](std::uint32_t pressed) { hand.Press(pressed); }, buttons, point, Vec3(0, -95, 0)};
}

TEST_F(ProveRun, AForceDimensionDeviceIsProven) {
  FakeDrd drd(folder_.path());
  std::snprintf(drd.device().system_name, sizeof drd.device().system_name, "omega.6");
  drd.device().has_wrist = true;
  ForceDimensionHand hand(drd.device());
  Vec3 at_mm = kFreeMm;
  hand.Place(at_mm);
  Start(
      "kind = \"forcedimension\"\nforcedimension_model = \"omega.6\"\nforcedimension_library = \"" +
      std::string(kFakeDrd) + "\"\n");
  ExpectProven("forcedimension", Slowly(hand, at_mm, 1, [&](const std::string& way) {
                 if (way == "away from you") hand.Turn(0.0, Vec3::UnitZ());
                 if (way == "down") hand.Turn(M_PI / 2, -Vec3::UnitY());
                 if (way == "to the right") hand.Turn(M_PI / 2, -Vec3::UnitZ());
               }));
  EXPECT_EQ(drd.Breaches(), std::vector<std::string>{});
  daemon_.reset();
  drd.device().present = false;
  Start("kind = \"forcedimension\"\nforcedimension_library = \"" + std::string(kFakeDrd) + "\"\n");
  Prove();
  ExpectRefused("find", "plug it in");
  daemon_.reset();
}

TEST_F(ProveRun, AHaplyDeviceIsProvenAndAServiceThatDoesNotRunIsNamed) {
  HaplyRig rig;
  HaplyHand& hand = rig.hand_;
  Vec3 at_mm = kFreeMm;
  hand.Place(at_mm);
  Start(rig.config());
  ExpectProven("haply", Slowly(hand, at_mm, 3, [&](const std::string& way) {
                 if (way == "away from you") hand.Turn(0.0, Vec3::UnitZ());
                 if (way == "down") hand.Turn(M_PI / 2, -Vec3::UnitX());
                 if (way == "to the right") hand.Turn(M_PI / 2, -Vec3::UnitZ());
               }));
  daemon_.reset();
  rig.service_.Restart(std::chrono::hours(1));
  Start(rig.config());
  Prove();
  ExpectRefused("find", "haply-inverse-service");
  daemon_.reset();
}

// The simulated hand follows these targets.
class LedHand {
 public:
  explicit LedHand(Daemon& daemon) : stream_(daemon.device->LeadHand(&context_)) {
    Aim(kFirstMm);
    thread_ = std::thread([this] {
      while (!ends_) {
        v1::LeadHandRequest request;
        {
          const std::scoped_lock lock(mutex_);
          request = request_;
        }
        if (!stream_->Write(request)) return;
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
      }
    });
  }
  ~LedHand() {
    ends_ = true;
    thread_.join();
    context_.TryCancel();
    stream_->Finish();
  }
  Hand hand() {
    return {[this](const Vec3& to_mm) {
              Aim(to_mm);
              std::this_thread::sleep_for(std::chrono::seconds(1));
            },
            [this](std::uint32_t buttons) {
              const std::scoped_lock lock(mutex_);
              request_.set_buttons(buttons);
            },
            2};
  }

 private:
  void Aim(const Vec3& at_mm) {
    const std::scoped_lock lock(mutex_);
    request_.mutable_target_mm()->set_x(at_mm.x());
    request_.mutable_target_mm()->set_y(at_mm.y());
    request_.mutable_target_mm()->set_z(at_mm.z());
  }

  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::LeadHandRequest, v1::LeadHandResponse>> stream_;
  std::mutex mutex_;
  v1::LeadHandRequest request_;
  std::atomic<bool> ends_ = false;
  std::thread thread_;
};

TEST_F(ProveRun, ASimulatedHandProvesNothing) {
  Start("kind = \"simulated\"\n");
  Prove();
  Answer("readings  ");
  ExpectRefused("readings", "still");  // it explores by itself
  EXPECT_EQ(ProofAt("proposed_level"), "simulated");
  LedHand led(*daemon_);
  ExpectProven("simulated", led.hand(), "simulated");
}

}  // namespace
}  // namespace palpate::test
