// The Touch on USB, without USB: what its frames mean, and what forces become.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <random>
#include <vector>

#include "common/error/error.h"
#include "server/device/omni/omni_usb_protocol.h"
#include "tests/support/allocation_count.h"
#include "tests/support/device_numbers.h"
#include "tests/support/omni_frames.h"
#include "tests/support/scaled.h"

namespace palpate {
namespace {

using Bytes = std::vector<std::uint8_t>;
using test::Framed;
using test::kInfinity;
using test::kNan;
using test::kOmniForce;
using test::kOmniState;
using test::NamedOmniUsbOptions;
using test::OmniReading;

OmniUsbOptions WithMotors(std::array<double, 3> counts_per_n_mm = {2.0, 2.0, 2.0}) {
  OmniUsbOptions options = NamedOmniUsbOptions();
  options.motor_counts_per_n_mm = counts_per_n_mm;
  return options;
}

Bytes StateFrame(const OmniReading& reading) {
  return Framed(kOmniState, test::OmniStatePayload(reading));
}

// A docked one so often that it counts; with a counter of its own unless it has one.
UsbReceived Receive(OmniUsbProtocol& protocol, OmniReading reading, DeviceState& state) {
  static std::uint32_t counter = 1000;
  const bool has_counter = reading.counter != 0;
  for (int n = 1; reading.docked && !has_counter && n < kOmniRestReadings; ++n) {
    reading.counter = ++counter;
    protocol.Receive(StateFrame(reading), state);
  }
  if (!has_counter) reading.counter = ++counter;
  return protocol.Receive(StateFrame(reading), state);
}

struct SentForce {
  std::array<int, 3> motors{};
  bool enabled = false;
};

SentForce Encoded(OmniUsbProtocol& protocol, const Vec3& force_D_n, bool forces_on = true) {
  std::array<std::uint8_t, UsbProtocol::kMaxFrameBytes> out{};
  EXPECT_EQ(protocol.Encode(force_D_n, forces_on, out), kOmniUsbHeaderBytes + kOmniForceBytes);
  EXPECT_EQ(out[2], kOmniForce);
  SentForce sent;
  for (std::size_t n = 0; n < 3; ++n) {
    sent.motors[n] = (out[4 + 2 * n] | out[5 + 2 * n] << 8) - 0x7ff;
  }
  sent.enabled = (out[10] & 8) != 0;
  EXPECT_EQ(out[10] & 0xf4, 0xc0);
  EXPECT_EQ(out[11], 0x53);
  return sent;
}

bool IsZeroAndOff(const SentForce& sent) {
  return !sent.enabled && sent.motors == std::array<int, 3>{};
}

// The published formulas, written down a second time.
Vec3 Published(const std::array<double, 3>& t) {
  const double l = 133.35, r = l * std::cos(t[1]) + l * std::sin(t[2]);
  return {-std::sin(t[0]) * r, l * std::sin(t[1]) - l * std::cos(t[2]) + 23.35,
          std::cos(t[0]) * r - 168.35};
}

TEST(OmniUsbState, APositionIsThatOfThePublishedFormulas) {
  OmniUsbProtocol protocol(NamedOmniUsbOptions());
  DeviceState state;
  Receive(protocol, {.encoders = {100, -200, 300}, .docked = true}, state);
  EXPECT_NEAR((state.p_DHip_mm - Vec3(0, -110, -35)).norm(), 0.0, 1e-9);
  EXPECT_TRUE(state.docked);
  EXPECT_TRUE(state.calibrated);
  std::mt19937 random(1);
  for (int n = 0; n < 1000; ++n) {
    const auto any = [&] { return static_cast<int>(random() % 4001) - 2000; };
    const std::array<int, 3> moved = {any(), any(), any()};
    const auto received =
        Receive(protocol, {.encoders = {100 + moved[0], -200 + moved[1], 300 + moved[2]}}, state);
    EXPECT_TRUE(received.has_reading);
    EXPECT_EQ(received.readings, 1u);
    EXPECT_FALSE(state.docked);
    const double rad = 2.0 * std::numbers::pi / 15000.0;
    ASSERT_LT(
        (state.p_DHip_mm - Published({moved[0] * rad, -moved[1] * rad, moved[2] * rad})).norm(),
        1e-9);
  }
}

TEST(OmniUsbState, TheNewestOfATransferCounts) {
  OmniUsbProtocol protocol(NamedOmniUsbOptions());
  Bytes bytes = {1, 2, 3};  // the end of a frame of before
  for (std::uint32_t n = 1; n <= 5; ++n) {
    const Bytes frame = StateFrame({.pressed = n == 5 ? 2u : 1u, .docked = true, .counter = n});
    bytes.insert(bytes.end(), frame.begin(), frame.end());
  }
  DeviceState state;
  const UsbReceived received = protocol.Receive(bytes, state);
  EXPECT_EQ(received.readings, 5u);
  EXPECT_EQ(received.lost_readings, 0u);
  EXPECT_EQ(received.corrupt_frames, 1u);
  EXPECT_EQ(state.buttons, 2u);
}

TEST(OmniUsbState, WithoutAReadingTheStateIsLeftAlone) {
  OmniUsbProtocol protocol(NamedOmniUsbOptions());
  DeviceState state;
  state.p_DHip_mm = Vec3(1, 2, 3);
  const Bytes frame = StateFrame({});
  EXPECT_FALSE(protocol.Receive(Framed(0x55, Bytes(44, 1)), state).has_reading);
  EXPECT_FALSE(protocol.Receive(std::span(frame).first(30), state).has_reading);
  EXPECT_FALSE(protocol.Receive({}, state).has_reading);
  EXPECT_EQ(state.p_DHip_mm, Vec3(1, 2, 3));
}

TEST(OmniUsbState, ButtonsAreActiveLow) {
  OmniUsbProtocol protocol(NamedOmniUsbOptions());
  DeviceState state;
  for (unsigned pressed = 0; pressed < 4; ++pressed) {
    for (const bool docked : {false, true}) {
      Receive(protocol, {.pressed = pressed, .docked = docked}, state);
      EXPECT_EQ(state.buttons, pressed);
      EXPECT_EQ(state.docked, docked);
    }
  }
}

TEST(OmniUsbState, GapsInTheCounterAreLostReadings) {
  OmniUsbProtocol protocol(NamedOmniUsbOptions());
  DeviceState state;
  const auto lost = [&](std::uint32_t counter) {
    return protocol.Receive(StateFrame({.counter = counter}), state).lost_readings;
  };
  EXPECT_EQ(lost(0xfffffff0u), 0u);  // the first: nothing to compare with
  EXPECT_EQ(lost(0xfffffff1u), 0u);
  EXPECT_EQ(lost(0xfffffff4u), 2u);
  EXPECT_EQ(lost(0xffffffffu), 10u);
  EXPECT_EQ(lost(0u), 0u);  // it wraps
  EXPECT_EQ(lost(1000u), 999u);
  EXPECT_EQ(lost(1000u), 0u);       // the same once more
  EXPECT_EQ(lost(990u), 0u);        // back
  EXPECT_EQ(lost(0x1000000u), 0u);  // a damaged number is no gap
  EXPECT_EQ(lost(991u), 0u);
  EXPECT_EQ(lost(993u), 1u);
}

TEST(OmniUsbState, WithoutAGimbalVoltageAFrameIsCorrupt) {
  OmniUsbProtocol protocol(NamedOmniUsbOptions());
  DeviceState state;
  const UsbReceived received = protocol.Receive(Framed(kOmniState, Bytes(44, 0)), state);
  EXPECT_FALSE(received.has_reading);
  EXPECT_EQ(received.corrupt_frames, 1u);
}

TEST(OmniUsbState, TheStylussAxes) {
  OmniUsbProtocol protocol(NamedOmniUsbOptions());
  DeviceState state;
  Receive(protocol, {.docked = true}, state);
  // Everything at 0: the barrel points to the user.
  EXPECT_LT((state.R_DS * Vec3::UnitZ() - Vec3::UnitZ()).norm(), 1e-9);
  EXPECT_LT((state.R_DS * Vec3::UnitX() - Vec3::UnitX()).norm(), 1e-9);
  // A roll of the barrel leaves its direction; the other two do not.
  Receive(protocol, {.gimbal_per_mille = {500, 500, 700}}, state);
  EXPECT_LT((state.R_DS * Vec3::UnitZ() - Vec3::UnitZ()).norm(), 1e-9);
  EXPECT_GT((state.R_DS * Vec3::UnitX() - Vec3::UnitX()).norm(), 0.5);
  for (const auto& turned : {std::array{700, 500, 500}, std::array{500, 700, 500}}) {
    Receive(protocol, {.gimbal_per_mille = turned}, state);
    EXPECT_GT((state.R_DS * Vec3::UnitZ() - Vec3::UnitZ()).norm(), 0.5);
    EXPECT_NEAR(state.R_DS.norm(), 1.0, 1e-12);
  }
  // The base to the left takes the barrel along; the second link level: barrel up.
  Receive(protocol, {.encoders = {1250, 0, 0}}, state);
  EXPECT_NEAR((state.R_DS * Vec3::UnitZ()).x(), -0.5, 1e-9);
  Receive(protocol, {.encoders = {0, 0, 15000 / 4}}, state);
  EXPECT_LT((state.R_DS * Vec3::UnitZ() - Vec3::UnitY()).norm(), 1e-9);
}

TEST(OmniUsbState, RandomBytesDoNoHarm) {
  std::mt19937 random(5);
  OmniUsbProtocol protocol(WithMotors());
  DeviceState state;
  for (int n = 0; n < test::Scaled(20000); ++n) {
    Bytes bytes(random() % 200);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
    if (n % 2) {
      bytes.resize(kOmniStateBytes, 3);
      bytes = Framed(kOmniState, bytes);
    }
    protocol.Receive(bytes, state);
    ASSERT_TRUE(state.p_DHip_mm.allFinite() && state.R_DS.coeffs().allFinite());
    ASSERT_LE(state.p_DHip_mm.norm(), 600.0);
    Encoded(protocol, Vec3(3, -3, 3));
  }
}

TEST(OmniUsbCalibration, UntilTheFirstDockPositionsHaveNoMeaning) {
  OmniUsbProtocol protocol(WithMotors());
  DeviceState state;
  Receive(protocol, {.encoders = {500, 500, 500}}, state);
  EXPECT_FALSE(state.calibrated);
  EXPECT_TRUE(IsZeroAndOff(Encoded(protocol, Vec3(0, 1, 0))));
  Receive(protocol, {.encoders = {500, 500, 500}, .docked = true}, state);
  EXPECT_TRUE(state.calibrated);
  EXPECT_TRUE(Encoded(protocol, Vec3(0, 1, 0)).enabled);
  // Every docking says it anew.
  Receive(protocol, {.encoders = {510, 510, 510}, .docked = true}, state);
  EXPECT_LT((state.p_DHip_mm - Vec3(0, -110, -35)).norm(), 1e-9);
}

TEST(OmniUsbCalibration, WaitsUntilTheStylusRests) {
  OmniUsbProtocol protocol(NamedOmniUsbOptions());
  DeviceState state;
  std::uint32_t counter = 1;
  const auto docked = [&](std::int16_t at) {
    protocol.Receive(StateFrame({.encoders = {at, 0, 0}, .docked = true, .counter = ++counter}),
                     state);
  };
  for (std::int16_t at = 0; at < 500; ++at) docked(at);  // it slides in
  EXPECT_FALSE(state.calibrated);
  for (int n = 1; n < kOmniRestReadings - 1; ++n) docked(499);
  EXPECT_FALSE(state.calibrated);
  docked(499);
  EXPECT_TRUE(state.calibrated);
  // One damaged frame moves nothing.
  docked(77);
  EXPECT_GT((state.p_DHip_mm - Vec3(0, -110, -35)).norm(), 1.0);
  docked(499);
  EXPECT_LT((state.p_DHip_mm - Vec3(0, -110, -35)).norm(), 1e-9);
}

TEST(OmniUsbState, TheSameFrameAgainIsNoReading) {
  OmniUsbProtocol protocol(NamedOmniUsbOptions());
  DeviceState state;
  EXPECT_TRUE(Receive(protocol, {.counter = 7}, state).has_reading);
  for (int n = 0; n < 10; ++n) EXPECT_FALSE(Receive(protocol, {.counter = 7}, state).has_reading);
  EXPECT_TRUE(Receive(protocol, {.counter = 8}, state).has_reading);
}

TEST(OmniUsbCalibration, OnRequestTheNextDockIsThePlaceOfRest) {
  OmniUsbProtocol protocol(NamedOmniUsbOptions());
  DeviceState state;
  Receive(protocol, {.docked = true}, state);
  EXPECT_TRUE(protocol.RequestCalibration());
  Receive(protocol, {.encoders = {40, 50, 60}}, state);
  EXPECT_FALSE(state.calibrated);
  Receive(protocol, {.encoders = {40, 50, 60}, .docked = true}, state);
  EXPECT_LT((state.p_DHip_mm - Vec3(0, -110, -35)).norm(), 1e-9);
}

TEST(OmniUsbCalibration, TheEncodersMayWrap) {
  OmniUsbProtocol protocol(NamedOmniUsbOptions());
  DeviceState near_wrap, far_from_it;
  Receive(protocol, {.encoders = {32760, -32760, 32767}, .docked = true}, near_wrap);
  Receive(protocol, {.encoders = {32760 + 100, -32760 - 100, 32767 + 100}}, near_wrap);
  OmniUsbProtocol other(NamedOmniUsbOptions());
  Receive(other, {.docked = true}, far_from_it);
  Receive(other, {.encoders = {100, -100, 100}}, far_from_it);
  EXPECT_EQ(near_wrap.p_DHip_mm, far_from_it.p_DHip_mm);
}

TEST(OmniUsbForce, IsTheTransposedJacobianTimesTheForce) {
  OmniUsbProtocol protocol(WithMotors({2.0, -3.0, 1.5}));
  DeviceState state;
  Receive(protocol, {.docked = true}, state);
  std::mt19937 random(4);
  const auto any = [&](double limit) {
    return std::uniform_real_distribution<double>(-limit, limit)(random);
  };
  for (int n = 0; n < 2000; ++n) {
    const auto counts = [&] { return static_cast<int>(any(2000)); };
    const std::array<int, 3> encoders = {counts(), counts(), counts()};
    Receive(protocol, {.encoders = encoders}, state);
    const double rad = 2.0 * std::numbers::pi / 15000.0;
    const std::array<double, 3> t = {encoders[0] * rad, -encoders[1] * rad, encoders[2] * rad};
    const Vec3 force(any(1.9), any(1.9), any(1.9));
    const SentForce sent = Encoded(protocol, force);
    ASSERT_TRUE(sent.enabled);
    const std::array<double, 3> gains = {2.0, -3.0, 1.5};
    std::array<double, 3> wanted{};
    double largest = 0.0;
    for (std::size_t joint = 0; joint < 3; ++joint) {
      auto a = t, b = t;
      a[joint] -= 1e-6;
      b[joint] += 1e-6;
      wanted[joint] = gains[joint] * force.dot((Published(b) - Published(a)) / 2e-6);
      largest = std::max(largest, std::abs(wanted[joint]));
    }
    const double scale = std::min(1.0, 2047.0 / largest);
    for (std::size_t joint = 0; joint < 3; ++joint) {
      ASSERT_NEAR(sent.motors[joint], scale * wanted[joint], 0.51);
    }
  }
}

TEST(OmniUsbForce, StaysWithinTheMotorsAndKeepsItsDirection) {
  OmniUsbProtocol protocol(WithMotors({10.0, 10.0, 10.0}));
  DeviceState state;
  Receive(protocol, {.docked = true}, state);
  Receive(protocol, {.encoders = {300, -900, 200}}, state);
  const SentForce strong = Encoded(protocol, Vec3(20, 20, 10)),
                  weak = Encoded(protocol, Vec3(2e-1, 2e-1, 1e-1));
  int largest = 0;
  for (std::size_t n = 0; n < 3; ++n) {
    largest = std::max(largest, std::abs(strong.motors[n]));
    // The ratios stay.
    EXPECT_NEAR(strong.motors[n] * std::abs(weak.motors[0]),
                weak.motors[n] * std::abs(strong.motors[0]), 3000);
  }
  EXPECT_EQ(largest, 2047);
  for (const double huge : {1e6, 1e100, 1e300, 1.7e308}) {
    for (const int counts : Encoded(protocol, Vec3(huge, -huge, huge)).motors) {
      EXPECT_LE(std::abs(counts), 2047);
    }
  }
}

TEST(OmniUsbForce, IsOffUnlessEverythingIsThere) {
  OmniUsbProtocol protocol(WithMotors());
  DeviceState state;
  EXPECT_TRUE(IsZeroAndOff(Encoded(protocol, Vec3(1, 1, 1))));  // no reading yet
  Receive(protocol, {.docked = true}, state);
  EXPECT_FALSE(IsZeroAndOff(Encoded(protocol, Vec3(1, 1, 1))));
  EXPECT_TRUE(IsZeroAndOff(Encoded(protocol, Vec3(1, 1, 1), false)));
  for (const double bad : {kNan, kInfinity, -kInfinity}) {
    EXPECT_TRUE(IsZeroAndOff(Encoded(protocol, Vec3(0, bad, 0))));
  }
  OmniUsbProtocol without_motors(NamedOmniUsbOptions());
  Receive(without_motors, {.docked = true}, state);
  EXPECT_TRUE(IsZeroAndOff(Encoded(without_motors, Vec3(1, 1, 1))));
}

TEST(OmniUsbForce, NoFramesAreNamed) {
  OmniUsbProtocol protocol({});
  DeviceState state;
  std::array<std::uint8_t, UsbProtocol::kMaxFrameBytes> out{};
  EXPECT_EQ(protocol.Encode(Vec3(1, 1, 1), true, out), 0u);
  const UsbReceived received = Receive(protocol, {.docked = true}, state);
  EXPECT_FALSE(received.has_reading);
  EXPECT_EQ(received.corrupt_frames, 0u);
}

TEST(OmniUsbRealTime, NothingAllocates) {
  OmniUsbProtocol protocol(WithMotors());
  std::array<std::uint8_t, UsbProtocol::kMaxFrameBytes> out{};
  DeviceState state;
  Bytes bytes = StateFrame({.docked = true});
  bytes.insert(bytes.end(), {1, 2, 3});
  for (int n = 0; n < 3; ++n) {
    const Bytes more = StateFrame({.encoders = {n, n, n}});
    bytes.insert(bytes.end(), more.begin(), more.end());
  }
  const std::uint64_t before = test::Allocations();
  for (int n = 0; n < 1000; ++n) {
    protocol.Receive(bytes, state);
    protocol.Receive(std::span(bytes).first(20), state);
    protocol.Encode(Vec3(1, 2, 3), n % 2 == 0, out);
    protocol.RequestCalibration();
  }
  EXPECT_EQ(test::Allocations(), before);
}

TEST(OmniUsbOptionsCheck, WhatDoesNotFitIsRefused) {
  OmniUsbOptions options;
  options.frames = OmniUsbFrames::kFramedFirewire;
  EXPECT_THROW(OmniUsbProtocol{options}, Error);
  options.state_command = kOmniState;
  EXPECT_THROW(OmniUsbProtocol{options}, Error);
  options.force_command = kOmniUsbServo.command;  // a force would switch the servo
  EXPECT_THROW(OmniUsbProtocol{options}, Error);
  options.force_command = kOmniForce;
  options.init_payload.emplace();
  EXPECT_NO_THROW(OmniUsbProtocol{options});
  options.motor_counts_per_n_mm = {1.0, kNan, 1.0};
  EXPECT_THROW(OmniUsbProtocol{options}, Error);
}

TEST(OmniUsbSpecification, IsThatOfTheDataSheetAndUnverified) {
  const DeviceSpec spec = OmniUsbSpec();
  EXPECT_EQ(spec.kind, "omni-usb");
  EXPECT_EQ(spec.verification_level, VerificationLevel::kNone);
  EXPECT_TRUE(IsHardware(spec));
  EXPECT_EQ(spec.workspace_max_mm, Vec3(80, 60, 35));
  EXPECT_EQ(spec.workspace_min_mm, Vec3(-80, -60, -35));
}

}  // namespace
}  // namespace palpate
