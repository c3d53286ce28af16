// The Touch on USB, without USB: what its frames mean, and what forces become.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <optional>
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

Bytes StateFrame(const OmniReading& reading) {
  return Framed(kOmniState, test::OmniStatePayload(reading));
}

struct SentForce {
  std::array<int, 3> motors{};
  bool enabled = false;
};

// The published formulas, written down a second time.
Vec3 Published(const std::array<double, 3>& t) {
  const double l = 133.35, r = l * std::cos(t[1]) + l * std::sin(t[2]);
  return {-std::sin(t[0]) * r, l * std::sin(t[1]) - l * std::cos(t[2]) + 23.35,
          std::cos(t[0]) * r - 168.35};
}

class OmniUsbTest : public ::testing::Test {
 protected:
  // A docked one so often that it counts; with a counter of its own unless it has one.
  UsbReceived Receive(OmniReading reading) {
    const bool has_counter = reading.counter != 0;
    for (int n = 1; reading.docked && !has_counter && n < kOmniRestReadings; ++n) {
      reading.counter = ++counter_;
      protocol_->Receive(StateFrame(reading), state_);
    }
    if (!has_counter) reading.counter = ++counter_;
    return protocol_->Receive(StateFrame(reading), state_);
  }
  SentForce Encoded(const Vec3& force_D_n, bool forces_on = true) {
    std::array<std::uint8_t, UsbProtocol::kMaxFrameBytes> out{};
    EXPECT_EQ(protocol_->Encode(force_D_n, forces_on, out), kOmniUsbHeaderBytes + kOmniForceBytes);
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
  bool IsOff(const Vec3& force_D_n, bool forces_on = true) {
    const SentForce sent = Encoded(force_D_n, forces_on);
    return !sent.enabled && sent.motors == std::array<int, 3>{};
  }
  void SetMotors(std::array<double, 3> counts_per_n_mm) {
    OmniUsbOptions options = NamedOmniUsbOptions();
    options.motor_counts_per_n_mm = counts_per_n_mm;
    protocol_.emplace(options);
  }
  bool IsAtRest() const { return (state_.p_DHip_mm - Vec3(0, -110, -35)).norm() < 1e-9; }

  std::optional<OmniUsbProtocol> protocol_{NamedOmniUsbOptions()};
  DeviceState state_;

 private:
  std::uint32_t counter_ = 1000;
};

TEST_F(OmniUsbTest, APositionIsThatOfThePublishedFormulas) {
  Receive({.encoders = {100, -200, 300}, .docked = true});
  EXPECT_TRUE(IsAtRest());
  EXPECT_TRUE(state_.docked);
  EXPECT_TRUE(state_.calibrated);
  std::mt19937 random(1);
  for (int n = 0; n < 1000; ++n) {
    const auto any = [&] { return static_cast<int>(random() % 4001) - 2000; };
    const std::array<int, 3> moved = {any(), any(), any()};
    const auto received = Receive({.encoders = {100 + moved[0], -200 + moved[1], 300 + moved[2]}});
    EXPECT_TRUE(received.has_reading);
    EXPECT_EQ(received.readings, 1u);
    EXPECT_FALSE(state_.docked);
    const double rad = 2.0 * std::numbers::pi / 15000.0;
    ASSERT_LT(
        (state_.p_DHip_mm - Published({moved[0] * rad, -moved[1] * rad, moved[2] * rad})).norm(),
        1e-9);
  }
}

TEST_F(OmniUsbTest, TheNewestOfATransferCounts) {
  Bytes bytes = {1, 2, 3};  // the end of a frame of before
  for (std::uint32_t n = 1; n <= 5; ++n) {
    const Bytes frame = StateFrame({.pressed = n == 5 ? 2u : 1u, .docked = true, .counter = n});
    bytes.insert(bytes.end(), frame.begin(), frame.end());
  }
  const UsbReceived received = protocol_->Receive(bytes, state_);
  EXPECT_EQ(received.readings, 5u);
  EXPECT_EQ(received.lost_readings, 0u);
  EXPECT_EQ(received.corrupt_frames, 1u);
  EXPECT_EQ(state_.buttons, 2u);
}

TEST_F(OmniUsbTest, WithoutAReadingTheStateIsLeftAlone) {
  state_.p_DHip_mm = Vec3(1, 2, 3);
  const Bytes frame = StateFrame({});
  EXPECT_FALSE(protocol_->Receive(Framed(0x55, Bytes(44, 1)), state_).has_reading);
  // Without a gimbal's voltage.
  EXPECT_EQ(protocol_->Receive(Framed(kOmniState, Bytes(44, 0)), state_).corrupt_frames, 1u);
  EXPECT_FALSE(protocol_->Receive(std::span(frame).first(30), state_).has_reading);
  EXPECT_FALSE(protocol_->Receive({}, state_).has_reading);
  EXPECT_EQ(state_.p_DHip_mm, Vec3(1, 2, 3));
}

TEST_F(OmniUsbTest, ButtonsAreActiveLow) {
  for (unsigned pressed = 0; pressed < 4; ++pressed) {
    for (const bool docked : {false, true}) {
      Receive({.pressed = pressed, .docked = docked});
      EXPECT_EQ(state_.buttons, pressed);
      EXPECT_EQ(state_.docked, docked);
    }
  }
}

TEST_F(OmniUsbTest, GapsInTheCounterAreLostReadingsAndTheSameFrameAgainIsNone) {
  const auto lost = [&](std::uint32_t counter) {
    return protocol_->Receive(StateFrame({.counter = counter}), state_).lost_readings;
  };
  EXPECT_EQ(lost(0xfffffff0u), 0u);  // the first: nothing to compare with
  EXPECT_EQ(lost(0xfffffff1u), 0u);
  EXPECT_EQ(lost(0xfffffff4u), 2u);
  EXPECT_EQ(lost(0xffffffffu), 10u);
  EXPECT_EQ(lost(0u), 0u);  // it wraps
  EXPECT_EQ(lost(1000u), 999u);
  EXPECT_FALSE(Receive({.counter = 1000}).has_reading);  // the same once more
  EXPECT_EQ(lost(990u), 0u);                             // back
  EXPECT_EQ(lost(0x1000000u), 0u);                       // a damaged number is no gap
  EXPECT_EQ(lost(991u), 0u);
  EXPECT_EQ(lost(993u), 1u);
}

// omni_test.cpp has the axes for all angles.
TEST_F(OmniUsbTest, TheGimbalTurnsTheStylus) {
  Receive({.docked = true});
  EXPECT_LT((state_.R_DS * Vec3::UnitZ() - Vec3::UnitZ()).norm(), 1e-9);
  EXPECT_LT((state_.R_DS * Vec3::UnitX() - Vec3::UnitX()).norm(), 1e-9);
  // A roll of the barrel leaves its direction; the other two do not.
  Receive({.gimbal_per_mille = {500, 500, 700}});
  EXPECT_LT((state_.R_DS * Vec3::UnitZ() - Vec3::UnitZ()).norm(), 1e-9);
  EXPECT_GT((state_.R_DS * Vec3::UnitX() - Vec3::UnitX()).norm(), 0.5);
  for (const auto& turned : {std::array{700, 500, 500}, std::array{500, 700, 500}}) {
    Receive({.gimbal_per_mille = turned});
    EXPECT_GT((state_.R_DS * Vec3::UnitZ() - Vec3::UnitZ()).norm(), 0.5);
  }
}

TEST_F(OmniUsbTest, RandomBytesDoNoHarm) {
  SetMotors({2.0, 2.0, 2.0});
  std::mt19937 random(5);
  for (int n = 0; n < test::Scaled(20000); ++n) {
    Bytes bytes(random() % 200);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
    if (n % 2) {
      bytes.resize(kOmniStateBytes, 3);
      bytes = Framed(kOmniState, bytes);
    }
    protocol_->Receive(bytes, state_);
    ASSERT_TRUE(state_.p_DHip_mm.allFinite() && state_.R_DS.coeffs().allFinite());
    ASSERT_LE(state_.p_DHip_mm.norm(), 600.0);
    Encoded(Vec3(3, -3, 3));
  }
}

TEST_F(OmniUsbTest, UntilTheFirstDockPositionsHaveNoMeaning) {
  SetMotors({2.0, 2.0, 2.0});
  Receive({.encoders = {500, 500, 500}});
  EXPECT_FALSE(state_.calibrated);
  EXPECT_TRUE(IsOff(Vec3(0, 1, 0)));
  Receive({.encoders = {500, 500, 500}, .docked = true});
  EXPECT_TRUE(state_.calibrated);
  EXPECT_TRUE(Encoded(Vec3(0, 1, 0)).enabled);
  // Every docking says it anew.
  Receive({.encoders = {510, 510, 510}, .docked = true});
  EXPECT_TRUE(IsAtRest());
  // On request the next one does.
  EXPECT_TRUE(protocol_->RequestCalibration());
  Receive({.encoders = {40, 50, 60}});
  EXPECT_FALSE(state_.calibrated);
  Receive({.encoders = {40, 50, 60}, .docked = true});
  EXPECT_TRUE(IsAtRest());
}

TEST_F(OmniUsbTest, ADockCountsOnceTheStylusRests) {
  std::uint32_t counter = 1;
  const auto dock = [&](std::int16_t at) {
    Receive({.encoders = {at, 0, 0}, .docked = true, .counter = ++counter});
  };
  for (std::int16_t at = 0; at < 500; ++at) dock(at);  // it slides in
  EXPECT_FALSE(state_.calibrated);
  for (int n = 1; n < kOmniRestReadings - 1; ++n) dock(499);
  EXPECT_FALSE(state_.calibrated);
  dock(499);
  EXPECT_TRUE(state_.calibrated);
  // One damaged frame moves nothing.
  dock(77);
  EXPECT_FALSE(IsAtRest());
  dock(499);
  EXPECT_TRUE(IsAtRest());
}

TEST_F(OmniUsbTest, TheEncodersMayWrap) {
  Receive({.encoders = {32760, -32760, 32767}, .docked = true});
  Receive({.encoders = {32760 + 100, -32760 - 100, 32767 + 100}});
  const Vec3 near_wrap_mm = state_.p_DHip_mm;
  Receive({.docked = true});
  Receive({.encoders = {100, -100, 100}});
  EXPECT_EQ(near_wrap_mm, state_.p_DHip_mm);
}

// omni_test.cpp has the torques.
TEST_F(OmniUsbTest, AForceBecomesTheTorquesTimesTheMotorsGainsWithinTheMotors) {
  const Vec3 gains(2.0, -3.0, 1.5);
  SetMotors({gains[0], gains[1], gains[2]});
  Receive({.docked = true});
  std::mt19937 random(4);
  const auto any = [&](double limit) {
    return std::uniform_real_distribution<double>(-limit, limit)(random);
  };
  for (int n = 0; n < 2000; ++n) {
    const auto counts = [&] { return static_cast<std::int16_t>(any(2000)); };
    const std::array<std::int16_t, 3> at = {counts(), counts(), counts()};
    Receive({.encoders = {at[0], at[1], at[2]}});
    const double limit_n = n % 2 == 0 ? 1.9 : 20.0;
    const Vec3 force(any(limit_n), any(limit_n), any(limit_n));
    const SentForce sent = Encoded(force);
    ASSERT_TRUE(sent.enabled);
    Vec3 wanted = gains.cwiseProduct(OmniTorques_n_mm(OmniJointsFromCounts(at), force));
    wanted *= std::min(1.0, 2047.0 / wanted.cwiseAbs().maxCoeff());
    for (int joint = 0; joint < 3; ++joint) {
      ASSERT_NEAR(sent.motors[static_cast<std::size_t>(joint)], wanted[joint], 0.51);
    }
  }
  for (const double huge : {1e6, 1e100, 1e300, 1.7e308}) {
    for (const int counts : Encoded(Vec3(huge, -huge, huge)).motors) {
      EXPECT_LE(std::abs(counts), 2047);
    }
  }
}

TEST_F(OmniUsbTest, ForcesAreOffUnlessEverythingIsThere) {
  EXPECT_EQ(protocol_->spec().verification_level, VerificationLevel::kNone);
  EXPECT_TRUE(IsHardware(protocol_->spec()));
  Receive({.docked = true});
  EXPECT_TRUE(IsOff(Vec3(1, 1, 1)));  // no motors
  SetMotors({2.0, 2.0, 2.0});
  EXPECT_TRUE(IsOff(Vec3(1, 1, 1)));  // no reading yet
  Receive({.docked = true});
  EXPECT_FALSE(IsOff(Vec3(1, 1, 1)));
  EXPECT_TRUE(IsOff(Vec3(1, 1, 1), false));
  for (const double bad : {kNan, kInfinity, -kInfinity}) EXPECT_TRUE(IsOff(Vec3(0, bad, 0)));
}

TEST_F(OmniUsbTest, WithoutNamedFramesThereIsNeitherReadingNorForce) {
  protocol_.emplace(OmniUsbOptions{});
  std::array<std::uint8_t, UsbProtocol::kMaxFrameBytes> out{};
  EXPECT_EQ(protocol_->Encode(Vec3(1, 1, 1), true, out), 0u);
  const UsbReceived received = Receive({.docked = true});
  EXPECT_FALSE(received.has_reading);
  EXPECT_EQ(received.corrupt_frames, 0u);
}

TEST_F(OmniUsbTest, NothingAllocates) {
  SetMotors({2.0, 2.0, 2.0});
  std::array<std::uint8_t, UsbProtocol::kMaxFrameBytes> out{};
  Bytes bytes = StateFrame({.docked = true});
  bytes.insert(bytes.end(), {1, 2, 3});
  for (int n = 0; n < 3; ++n) {
    const Bytes more = StateFrame({.encoders = {n, n, n}});
    bytes.insert(bytes.end(), more.begin(), more.end());
  }
  const std::uint64_t before = test::Allocations();
  for (int n = 0; n < 1000; ++n) {
    protocol_->Receive(bytes, state_);
    protocol_->Receive(std::span(bytes).first(20), state_);
    protocol_->Encode(Vec3(1, 2, 3), n % 2 == 0, out);
    protocol_->RequestCalibration();
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

}  // namespace
}  // namespace palpate
