// Kinematics and frames of the Phantom Omni and of the Touch, without a device.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "server/device/omni/omni_arm.h"
#include "server/device/omni/omni_frames.h"
#include "tests/support/omni_frames.h"
#include "tests/support/scaled.h"

namespace palpate {
namespace {

OmniJoints RandomJoints(std::mt19937& random) {
  const auto any = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  // The elbow's link is below the first one: elbow - 90° < shoulder.
  OmniJoints joints{any(-1.0, 1.0), any(0.0, 1.7), 0.0};
  joints.elbow_rad = any(std::max(-0.5, joints.shoulder_rad - 1.0), joints.shoulder_rad + 1.5);
  return joints;
}

// The joints for a position, with the elbow up. In the plane of the arm, in links: (reach, height)
// = (cos s + sin e, sin s - cos e). With e = o + 90°, this is the sum of the unit vectors at s and
// o. The sum's direction bisects the two. Out of reach: no numbers.
OmniJoints JointsAt(const Vec3& p_M_mm) {
  const Vec3 p_mm = p_M_mm - Vec3(0.0, 23.35, -168.35);  // from base's and shoulder's crossing
  const double reach = std::hypot(p_mm.x(), p_mm.z()) / kOmniLinkMm;
  const double height = p_mm.y() / kOmniLinkMm;
  const double middle_rad = std::atan2(height, reach);
  const double half_rad = std::acos(0.5 * std::hypot(reach, height));
  return {.base_rad = std::atan2(-p_mm.x(), p_mm.z()),
          .shoulder_rad = middle_rad + half_rad,
          .elbow_rad = middle_rad - half_rad + 0.5 * std::numbers::pi};
}

TEST(OmniKinematics, TheJacobianIsTheDerivative) {
  std::mt19937 random(1);
  constexpr double kStepRad = 1e-6;
  for (int n = 0; n < 1000; ++n) {
    const OmniJoints q = RandomJoints(random);
    const Mat3 jacobian = OmniJacobian(q);
    for (int joint = 0; joint < 3; ++joint) {
      OmniJoints a = q, b = q;
      double OmniJoints::*members[] = {&OmniJoints::base_rad, &OmniJoints::shoulder_rad,
                                       &OmniJoints::elbow_rad};
      a.*members[joint] -= kStepRad;
      b.*members[joint] += kStepRad;
      const Vec3 slope = (OmniPosition(b) - OmniPosition(a)) / (2.0 * kStepRad);
      ASSERT_LT((jacobian.col(joint) - slope).norm(), 1e-6);
    }
    // Virtual work: what the motors do is what the hand gets.
    const Vec3 force(0.3, -1.2, 0.7), motion(1e-3, -2e-3, 5e-4);
    ASSERT_NEAR(OmniTorques_n_mm(q, force).dot(motion), force.dot(jacobian * motion), 1e-12);
  }
}

TEST(OmniKinematics, TheStylusFollowsTheSecondLink) {
  std::mt19937 random(4);
  for (int n = 0; n < 1000; ++n) {
    const OmniJoints q = RandomJoints(random);
    // The elbow turns the second link alone: the tip moves across it, in the arm's plane.
    const Vec3 across = OmniJacobian(q).col(2).normalized();
    const Eigen::Quaterniond level = OmniOrientation(q, {0, 0, 0});
    ASSERT_LT((level * Vec3::UnitZ() - across).norm(), 1e-9);
    const Vec3 arms_normal(std::cos(q.base_rad), 0.0, std::sin(q.base_rad));
    ASSERT_LT((level * Vec3::UnitX() - arms_normal).norm(), 1e-9);
    // Yaw goes round the link, pitch about what is across both, roll about the barrel.
    ASSERT_LT((OmniOrientation(q, {0.7, 0, 0}) * Vec3::UnitY() - level * Vec3::UnitY()).norm(),
              1e-9);
    ASSERT_NEAR((OmniOrientation(q, {0.7, 0.4, 0}) * Vec3::UnitX()).dot(level * Vec3::UnitY()), 0.0,
                1e-9);
    ASSERT_LT((OmniOrientation(q, {0.7, 0.4, 1.1}) * Vec3::UnitZ() -
               OmniOrientation(q, {0.7, 0.4, 0}) * Vec3::UnitZ())
                  .norm(),
              1e-9);
    ASSERT_NEAR(OmniOrientation(q, {0.7, 0.4, 1.1}).norm(), 1.0, 1e-12);
  }
}

TEST(OmniKinematics, TheCornersOfTheWorkspaceAreWithinReach) {
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 p(corner & 1 ? 80.0 : -80.0, corner & 2 ? 60.0 : -60.0, corner & 4 ? 35.0 : -35.0);
    const OmniJoints q = JointsAt(p);
    ASSERT_LT((OmniPosition(q) - p).norm(), 1e-9);
    // Far from where the arm's own stops could be: a fourth of a turn or so either way.
    EXPECT_LT(std::abs(q.base_rad), 0.6);
    EXPECT_GT(q.shoulder_rad, 0.0);
    EXPECT_LT(q.shoulder_rad, 1.5);
    EXPECT_LT(std::abs(q.elbow_rad), 1.4);
    // No singularity: every force needs finite torques, and every motion is seen.
    EXPECT_GT(std::abs(OmniJacobian(q).determinant()), 1e5);
  }
}

// A count of the shoulder or the elbow moves the tip by 0.0559 mm anywhere, the data
// sheet's figure; one of the base by 0.0705 mm at the origin, and more further out.
TEST(OmniKinematics, ACountIsTheDatasheetsResolution) {
  EXPECT_NEAR(kOmniRadPerCount * kOmniLinkMm, 0.055, 0.001);
  const Mat3 mm_per_count = OmniJacobian(JointsAt(Vec3::Zero())) * kOmniRadPerCount;
  EXPECT_NEAR(mm_per_count.col(0).norm(), 0.0705, 1e-4);
  EXPECT_NEAR(mm_per_count.col(1).norm(), 0.0559, 1e-4);
  EXPECT_NEAR(mm_per_count.col(2).norm(), 0.0559, 1e-4);
  const OmniJoints q = OmniJointsFromCounts({15000 / 4, -15000 / 8, 0});
  EXPECT_DOUBLE_EQ(q.base_rad, std::numbers::pi / 2);
  EXPECT_DOUBLE_EQ(q.shoulder_rad, std::numbers::pi / 4);
}

// Encoders -2, 300 and -32768, the gimbal in its middle, button 1 pressed, number 0x12345678.
const std::vector<std::uint8_t> kRawOmniState = {
    0, 0, 0,    0,    0xfe,  0xff, 0x2c, 1,   0, 0x80, 100, 0,   100, 0, 100,
    0, 0, 0,    0,    0b101, 0,    0,    100, 0, 100,  0,   100, 0,   0, 0,
    0, 0, 0x78, 0x56, 0x34,  0x12, 0,    0,   0, 0,    0,   0,   0,   0};

TEST(OmniFrames, AStateIsDecoded) {
  const auto state = DecodeOmniState(kRawOmniState);
  ASSERT_TRUE(state);
  EXPECT_EQ(state->encoders, (std::array<std::int16_t, 3>{-2, 300, -32768}));
  for (const double angle : state->gimbal_rad) EXPECT_NEAR(angle, 0.0, 1e-12);
  EXPECT_EQ(state->buttons, (std::array<bool, 2>{false, true}));
  EXPECT_FALSE(state->docked);
  EXPECT_EQ(state->counter, 0x12345678u);
}

TEST(OmniFrames, WhatIsNoStateIsRefused) {
  auto bytes = kRawOmniState;
  bytes.pop_back();
  EXPECT_FALSE(DecodeOmniState(bytes));
  // The device may send more than is known of.
  bytes = kRawOmniState;
  for (const std::size_t size : {44u, 45u, 64u}) {
    bytes.resize(size);
    EXPECT_TRUE(DecodeOmniState(bytes)) << size;
  }
  bytes.resize(65);
  EXPECT_FALSE(DecodeOmniState(bytes));
  EXPECT_FALSE(DecodeOmniState({}));
  EXPECT_FALSE(DecodeOmniState(std::vector<std::uint8_t>(kOmniStateBytes, 0)));
}

TEST(OmniFrames, RandomBytesGiveAnglesWithinTheGimbalsRange) {
  std::mt19937 random(3);
  std::vector<std::uint8_t> bytes(kOmniStateBytes);
  for (int n = 0; n < test::Scaled(20000); ++n) {
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
    const auto state = DecodeOmniState(bytes);
    if (!state) continue;
    for (const double angle : state->gimbal_rad) ASSERT_LE(std::abs(angle), 2.75);
  }
}

TEST(OmniFrames, AForceIsEncoded) {
  const auto zero = EncodeOmniForce({});
  EXPECT_EQ(zero, (std::array<std::uint8_t, 16>{0xff, 7, 0xff, 7, 0xff, 7, 0xc0, 0x53}));
  const auto bytes =
      EncodeOmniForce({.motors = {1, -2047, 1'000'000}, .force_enabled = true, .dock_light = 2});
  EXPECT_EQ(bytes, (std::array<std::uint8_t, 16>{0x00, 8, 0, 0, 0xfe, 0x0f, 0xca, 0x53}));
}

// --- The framing of the Touch's serial line: cut anywhere, damaged anywhere

using Bytes = std::vector<std::uint8_t>;
using test::Framed;

struct Frame {
  std::uint8_t command = 0;
  Bytes payload{};
  bool operator==(const Frame&) const = default;
};

std::vector<Frame> ParseAll(OmniUsbParser& parser, std::span<const std::uint8_t> bytes) {
  std::vector<Frame> frames;
  while (const auto frame = parser.Next(bytes)) {
    frames.push_back({frame->command, Bytes(frame->payload.begin(), frame->payload.end())});
  }
  EXPECT_TRUE(bytes.empty());
  return frames;
}

std::vector<Frame> ParseCut(OmniUsbParser& parser, std::span<const std::uint8_t> bytes,
                            std::mt19937& random, std::size_t longest) {
  std::vector<Frame> frames;
  while (!bytes.empty()) {
    const std::size_t cut = std::min<std::size_t>(random() % (longest + 1), bytes.size());
    for (Frame& frame : ParseAll(parser, bytes.first(cut))) frames.push_back(std::move(frame));
    bytes = bytes.subspan(cut);
  }
  return frames;
}

Bytes JoinedBytes(std::initializer_list<Bytes> parts) {
  Bytes all;
  for (const Bytes& part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}

// Frames without a start in their payload, so that each is found again after damage.
std::vector<Frame> PlainFrames(std::mt19937& random, std::size_t count) {
  std::vector<Frame> frames;
  for (std::size_t n = 0; n < count; ++n) {
    Bytes payload(random() % 256);
    for (auto& byte : payload) byte = static_cast<std::uint8_t>(random() % 0xa5);
    frames.push_back({static_cast<std::uint8_t>(random()), payload});
  }
  return frames;
}

Bytes Stream(const std::vector<Frame>& frames) {
  Bytes bytes;
  for (const Frame& frame : frames)
    bytes = JoinedBytes({bytes, Framed(frame.command, frame.payload)});
  return bytes;
}

TEST(OmniUsbFrames, TheTracesBytesAreEncoded) {
  EXPECT_EQ(Framed(kOmniUsbSerialQuery.command, Bytes{0}), (Bytes{0xa5, 0x5a, 0x0c, 0x01, 0x00}));
  EXPECT_EQ(Framed(kOmniUsbServo.command, kOmniUsbServoOn),
            (Bytes{0xa5, 0x5a, 0x07, 0x07, 0x01, 0, 0, 0x80, 0, 0, 0}));
  const Bytes query = Framed(kOmniUsbFirmwareQuery.command, Bytes(32, 0));
  EXPECT_EQ(query.size(), 36u);
  EXPECT_EQ(query[2], 0x0f);
  EXPECT_EQ(query[3], 0x20);
}

TEST(OmniUsbFrames, WhatDoesNotFitIsNotEncoded) {
  Bytes out(kOmniUsbMaxFrameBytes + 10, 0xee);
  const Bytes untouched = out;
  EXPECT_EQ(EncodeOmniUsbFrame(1, Bytes(256), out), 0u);
  EXPECT_EQ(EncodeOmniUsbFrame(1, Bytes(10), std::span(out).first(13)), 0u);
  EXPECT_EQ(EncodeOmniUsbFrame(1, {}, {}), 0u);
  EXPECT_EQ(out, untouched);
  EXPECT_EQ(EncodeOmniUsbFrame(1, Bytes(255), out), kOmniUsbMaxFrameBytes);
  EXPECT_EQ(EncodeOmniUsbFrame(1, Bytes(10), std::span(out).first(14)), 14u);
}

TEST(OmniUsbFrames, CutsDoNotMatter) {
  std::mt19937 random(1);
  for (int n = 0; n < test::Scaled(100); ++n) {
    // Any payload, with starts in it too: within a frame they mean nothing.
    std::vector<Frame> frames = PlainFrames(random, 30);
    for (Frame& frame : frames) {
      for (auto& byte : frame.payload) byte = random() % 3 ? byte : random() % 2 ? 0xa5 : 0x5a;
    }
    OmniUsbParser parser;
    ASSERT_EQ(ParseCut(parser, Stream(frames), random, n % 3 == 0 ? 1 : 700), frames);
    ASSERT_EQ(parser.corrupt_bytes(), 0u);
  }
}

TEST(OmniUsbFrames, CutsDoNotMatterInNoiseEither) {
  std::mt19937 random(2);
  for (int n = 0; n < 300; ++n) {
    Bytes noise(5000);
    for (auto& byte : noise) {
      byte = static_cast<std::uint8_t>(random() % 4 ? random() : random() % 2 ? 0xa5 : 0x5a);
    }
    OmniUsbParser whole, cut;
    ASSERT_EQ(ParseAll(whole, noise), ParseCut(cut, noise, random, 40));
    ASSERT_EQ(whole.corrupt_bytes(), cut.corrupt_bytes());
    ASSERT_EQ(whole.corrupt_runs(), cut.corrupt_runs());
  }
}

TEST(OmniUsbFrames, GarbageBetweenFramesIsPassedOverAndCounted) {
  OmniUsbParser parser;
  const Bytes one = Framed(0x21, Bytes{1, 2, 3}), two = Framed(0x22, {});
  const Bytes stream =
      JoinedBytes({{0, 1, 2}, one, two, {0xa5, 0xa5, 0x5b}, one, {0xa5}, two, {0x5a}});
  const auto frames = ParseAll(parser, stream);
  ASSERT_EQ(frames.size(), 4u);
  EXPECT_EQ(frames[0], (Frame{0x21, {1, 2, 3}}));
  EXPECT_EQ(frames[3], (Frame{0x22, {}}));
  EXPECT_EQ(parser.corrupt_bytes(), 3u + 3u + 1u + 1u);
  EXPECT_EQ(parser.corrupt_runs(), 4u);
}

// Where a length is damaged, 255 bytes are the worst.
TEST(OmniUsbFrames, ADamagedLengthTakesNoMoreThanAFrameAlong) {
  std::mt19937 random(3);
  std::vector<Frame> frames = PlainFrames(random, 60);
  for (Frame& frame : frames) frame.payload.resize(44, 1);
  for (unsigned length = 0; length < 256; ++length) {
    Bytes bytes = Stream(frames);
    bytes[3] = static_cast<std::uint8_t>(length);
    OmniUsbParser parser;
    const auto found = ParseAll(parser, bytes);
    ASSERT_GE(found.size(), frames.size() - 7);
    ASSERT_TRUE(std::equal(frames.end() - 50, frames.end(), found.end() - 50));
  }
}

}  // namespace
}  // namespace palpate
