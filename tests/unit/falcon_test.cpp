// Kinematics and frames of the Novint Falcon, without a device.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "server/device/falcon/frames.h"
#include "server/device/falcon/kinematics.h"
#include "tests/support/scaled.h"

namespace palpate {
namespace {

constexpr double kBallMm = 50.0;

Vec3 InBall(std::mt19937& random, double radius_mm = kBallMm) {
  std::uniform_real_distribution<double> any(-radius_mm, radius_mm);
  for (;;) {
    const Vec3 p(any(random), any(random), any(random));
    if (p.norm() <= radius_mm) return p;
  }
}

// The three arms are alike: a third of a turn hands each one's part to the next.
Vec3 TurnedByThird(const Vec3& p) {
  return Eigen::AngleAxisd(2.0 / 3.0 * std::numbers::pi, Vec3::UnitZ()) * p;
}

TEST(FalconKinematics, ForwardLeadsBackAllOverTheBall) {
  std::mt19937 random(1);
  double worst_mm = 0.0;
  for (int n = 0; n < test::Scaled(50'000); ++n) {
    const Vec3 p = InBall(random);
    Vec3 angles, back;
    ASSERT_TRUE(FalconAnglesAt(p, angles)) << p.transpose();
    ASSERT_TRUE(FalconPositionAt(angles, back)) << p.transpose();
    worst_mm = std::max(worst_mm, (back - p).norm());
  }
  EXPECT_LT(worst_mm, 1e-9);
}

TEST(FalconKinematics, TheBaseIsBehindAndOutwardsIsTowardsTheUser) {
  Vec3 in, out;
  ASSERT_TRUE(FalconPositionAt(Vec3::Constant(0.2), in));
  ASSERT_TRUE(FalconPositionAt(Vec3::Constant(0.9), out));
  EXPECT_NEAR(in.head<2>().norm(), 0.0, 1e-9);
  EXPECT_NEAR(out.head<2>().norm(), 0.0, 1e-9);
  EXPECT_GT(out.z(), in.z() + 20.0);
  // The homed zero is in the middle of libnifalcon's 75 to 175 mm within 15 mm.
  Vec3 zero;
  ASSERT_TRUE(FalconPositionAt(FalconAnglesFromCounts({0, 0, 0}), zero));
  EXPECT_NEAR(zero.z(), 0.0, 15.0);
}

TEST(FalconKinematics, AThirdOfATurnExchangesTheArms) {
  std::mt19937 random(3);
  for (int n = 0; n < test::Scaled(10'000); ++n) {
    const Vec3 p = InBall(random);
    Vec3 angles, turned;
    ASSERT_TRUE(FalconAnglesAt(p, angles));
    ASSERT_TRUE(FalconAnglesAt(TurnedByThird(p), turned));
    // The arms are at 105°, -15° and -135°: each is a third of a turn before the last.
    ASSERT_LT((Vec3(angles[1], angles[2], angles[0]) - turned).norm(), 1e-9);
  }
}

TEST(FalconKinematics, TheJacobianIsTheDerivative) {
  std::mt19937 random(4);
  constexpr double kStepRad = 1e-5;
  for (int n = 0; n < 2'000; ++n) {
    const Vec3 p = InBall(random, 45.0);
    Vec3 angles;
    Mat3 jacobian;
    ASSERT_TRUE(FalconAnglesAt(p, angles));
    ASSERT_TRUE(FalconJacobianAt(p, angles, jacobian));
    for (int arm = 0; arm < 3; ++arm) {
      Vec3 before, after;
      ASSERT_TRUE(FalconPositionAt(angles - kStepRad * Vec3::Unit(arm), before));
      ASSERT_TRUE(FalconPositionAt(angles + kStepRad * Vec3::Unit(arm), after));
      const Vec3 slope = (after - before) / (2.0 * kStepRad);
      ASSERT_LT((jacobian.col(arm) - slope).norm(), 1e-4) << p.transpose();
    }
  }
}

TEST(FalconKinematics, ACountIsTheDatasheetsResolutionOrFiner) {
  EXPECT_NEAR(kFalconRadPerCount * 180.0 / std::numbers::pi, 0.036435, 1e-6);
  std::mt19937 random(6);
  double sum_mm = 0.0;
  constexpr int kCount = 1'000;
  for (int n = 0; n < kCount; ++n) {
    const Vec3 p = InBall(random, 40.0);
    Vec3 angles;
    Mat3 jacobian;
    ASSERT_TRUE(FalconAnglesAt(p, angles));
    ASSERT_TRUE(FalconJacobianAt(p, angles, jacobian));
    sum_mm += jacobian.colwise().norm().mean() * kFalconRadPerCount;
  }
  // 400 counts per inch.
  EXPECT_LT(sum_mm / kCount, 25.4 / 400.0);
  EXPECT_GT(sum_mm / kCount, 0.25 * 25.4 / 400.0);
}

TEST(FalconKinematics, CountsAreAnglesAndBack) {
  for (int count = -32768; count <= 32767; ++count) {
    const auto n = static_cast<std::int16_t>(count);
    const std::array<std::int16_t, 3> counts = {n, static_cast<std::int16_t>(-(n / 2)), 0};
    ASSERT_EQ(FalconCountsFromAngles(FalconAnglesFromCounts(counts)), counts);
  }
  EXPECT_EQ(FalconCountsFromAngles(Vec3(1e9, -1e9, 0.0))[0], 32767);
}

TEST(FalconKinematics, WhatNoPoseHasIsRefused) {
  const double nan = std::nan(""), infinity = HUGE_VAL;
  Vec3 unused(7.0, 7.0, 7.0);
  for (const Vec3& p_mm : {Vec3(0.0, 0.0, 400.0), Vec3(0.0, 0.0, -400.0), Vec3(50.8, 50.8, 50.8),
                           Vec3(0.0, nan, 0.0), Vec3(infinity, 0.0, 0.0)}) {
    EXPECT_FALSE(FalconAnglesAt(p_mm, unused)) << p_mm.transpose();
  }
  for (const Vec3& angles : {Vec3(nan, 0.5, 0.5), Vec3(0.5, infinity, 0.5),
                             Vec3(0.5, 0.5, -infinity), Vec3(20.0, 0.5, 0.5)}) {
    EXPECT_FALSE(FalconPositionAt(angles, unused)) << angles.transpose();
  }
  EXPECT_EQ(unused, Vec3(7.0, 7.0, 7.0));
  Mat3 jacobian;
  EXPECT_FALSE(FalconJacobianAt(Vec3(1e200, 5.0, 1e200), Vec3::Zero(), jacobian));
  EXPECT_FALSE(FalconJacobianAt(Vec3(0.0, nan, 0.0), Vec3::Zero(), jacobian));
}

// Every position that comes out goes back to the angles that went in, however wild.
TEST(FalconKinematics, AnyAnglesGiveTheirPositionOrNone) {
  std::mt19937 random(7);
  std::uniform_int_distribution<int> any(-32768, 32767), near(-4000, 4000);
  int found = 0;
  for (int n = 0; n < 200'000; ++n) {
    auto& counts = n % 2 == 0 ? any : near;
    const auto draw = [&] { return static_cast<std::int16_t>(counts(random)); };
    const Vec3 angles = FalconAnglesFromCounts({draw(), draw(), draw()});
    Vec3 p, back;
    if (!FalconPositionAt(angles, p)) continue;
    ++found;
    ASSERT_TRUE(p.allFinite());
    ASSERT_TRUE(FalconAnglesAt(p, back));
    ASSERT_LT((back - angles).norm(), 1e-5);
  }
  EXPECT_GT(found, 1'000);
}

TEST(FalconKinematics, ForcesWithinTheBoundNeedNoScaling) {
  std::mt19937 random(8);
  double greatest = 0.0;
  for (int n = 0; n < test::Scaled(20'000); ++n) {
    const Vec3 p = InBall(random), force = 3.3 * InBall(random, 1.0).normalized();
    Vec3 angles;
    Mat3 jacobian;
    ASSERT_TRUE(FalconAnglesAt(p, angles));
    ASSERT_TRUE(FalconJacobianAt(p, angles, jacobian));
    const Vec3 counts = kFalconMotorCountsPerNmm * (jacobian.transpose() * force);
    greatest = std::max(greatest, counts.cwiseAbs().maxCoeff());
  }
  EXPECT_LT(greatest, kFalconMotorLimit);
  EXPECT_GT(greatest, kFalconMotorLimit / 4.0);
}

TEST(FalconKinematics, GreatTorquesKeepTheirDirection) {
  const auto motors = FalconMotorsFromTorques(Vec3(1e6, -5e5, 0.0));
  EXPECT_EQ(motors, (std::array<std::int16_t, 3>{-kFalconMotorLimit, kFalconMotorLimit / 2, 0}));
  EXPECT_EQ(FalconMotorsFromTorques(Vec3(1.0, std::nan(""), 0.0)),
            (std::array<std::int16_t, 3>{0, 0, 0}));
  EXPECT_EQ(FalconMotorsFromTorques(Vec3(1e308, 1e308, -1e308)),
            (std::array<std::int16_t, 3>{0, 0, 0}));
  EXPECT_EQ(FalconMotorsFromTorques(Vec3(1.0, -2.0, 0.04)),
            (std::array<std::int16_t, 3>{-10, 20, 0}));
}

// --- Frames, and how they are found in a stream

using Bytes = std::vector<std::uint8_t>;

Bytes Joined(const std::vector<FalconReport>& reports) {
  Bytes bytes;
  for (const auto& report : reports) {
    const FalconFrame frame = EncodeFalconReport(report);
    bytes.insert(bytes.end(), frame.begin(), frame.end());
  }
  return bytes;
}

std::vector<FalconReport> SomeReports(int count) {
  std::mt19937 random(1);
  std::vector<FalconReport> reports;
  for (int n = 0; n < count; ++n) {
    const auto draw = [&] { return static_cast<std::int16_t>(random()); };
    reports.push_back({.encoders = {draw(), draw(), draw()},
                       .buttons = static_cast<std::uint8_t>(random() % 16),
                       .homed = static_cast<std::uint8_t>(random() % 8)});
  }
  return reports;
}

std::vector<FalconReport> Found(FalconFrameFinder& finder, const Bytes& bytes) {
  std::vector<FalconReport> reports;
  for (const std::uint8_t byte : bytes) {
    if (!finder.Push(byte)) continue;
    const auto report = DecodeFalconReport(finder.frame());
    EXPECT_TRUE(report);
    if (report) reports.push_back(*report);
  }
  return reports;
}

// As the FTDI chip sends a stream: packets of at most 62 bytes behind its status.
Bytes AsTransfer(const Bytes& bytes) {
  Bytes transfer;
  std::size_t at = 0;
  do {
    // Its status may look like the end of a frame.
    transfer.insert(transfer.end(), {0x01, '<'});
    const std::size_t take = std::min(kFtdiPacketBytes - kFtdiStatusBytes, bytes.size() - at);
    transfer.insert(transfer.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at),
                    bytes.begin() + static_cast<std::ptrdiff_t>(at + take));
    at += take;
  } while (at < bytes.size());
  return transfer;
}

TEST(FalconFrames, ACommandIsWhatTheFirmwareWants) {
  const FalconFrame frame =
      EncodeFalconCommand({.motors = {0x1234, -1, 0}, .lights = kFalconRedLight, .homing = true});
  const std::string text(frame.begin(), frame.end());
  // 0x1234 lowest nibble first: 4 3 2 1; 0x41 + 8 + 1 is J.
  EXPECT_EQ(text, "<EDCBPPPPAAAAJA>");
}

TEST(FalconFrames, EveryNumberComesBack) {
  for (int n = -32768; n <= 32767; ++n) {
    const auto a = static_cast<std::int16_t>(n), b = static_cast<std::int16_t>(~n),
               c = static_cast<std::int16_t>(n * 7);
    const FalconCommand command{
        .motors = {a, b, c}, .lights = static_cast<std::uint8_t>(n & 0xe), .homing = n % 2 == 0};
    ASSERT_EQ(DecodeFalconCommand(EncodeFalconCommand(command)), command);
    const FalconReport report{.encoders = {c, a, b},
                              .buttons = static_cast<std::uint8_t>(n & 0xf),
                              .homed = static_cast<std::uint8_t>(n >> 4 & 7)};
    ASSERT_EQ(DecodeFalconReport(EncodeFalconReport(report)), report);
  }
}

TEST(FalconFrames, FlagsBeyondTheirBitsAreCutOffAndAllThreeEncodersAreHome) {
  for (std::uint8_t homed = 0; homed < 8; ++homed) {
    EXPECT_EQ((FalconReport{.homed = homed}.is_homed()), homed == 7);
  }
  const auto report = DecodeFalconReport(EncodeFalconReport({.buttons = 0xff, .homed = 0xff}));
  ASSERT_TRUE(report);
  EXPECT_EQ(report->buttons, 0xf);
  EXPECT_TRUE(report->is_homed());
  const auto command = DecodeFalconCommand(EncodeFalconCommand({.lights = 0xff}));
  ASSERT_TRUE(command);
  EXPECT_EQ(command->lights, 0xe);
  EXPECT_FALSE(command->homing);
}

TEST(FalconFrames, WhatIsNoFrameIsRefused) {
  const FalconFrame good = EncodeFalconReport({.encoders = {1, 2, 3}});
  EXPECT_FALSE(DecodeFalconReport({}));
  EXPECT_FALSE(DecodeFalconReport(std::span(good).first(15)));
  Bytes longer(good.begin(), good.end());
  longer.push_back('>');
  EXPECT_FALSE(DecodeFalconReport(longer));
  // Each byte with each value: what is taken, is one of those that the encoder makes,
  // but for the byte that means nothing.
  for (std::size_t at = 0; at < good.size(); ++at) {
    for (int value = 0; value < 256; ++value) {
      FalconFrame frame = good;
      frame[at] = static_cast<std::uint8_t>(value);
      const auto report = DecodeFalconReport(frame);
      if (!report) continue;
      FalconFrame again = EncodeFalconReport(*report);
      if (at == 14) again[at] = frame[at];
      ASSERT_EQ(again, frame) << at << " " << value;
    }
  }
}

TEST(FalconFrames, GarbageBetweenFramesIsCountedAndSkipped) {
  const auto reports = SomeReports(3);
  Bytes bytes = {0x00, 'A', '>', 0xff};
  const auto add = [&](const FalconReport& report) {
    const Bytes frame = Joined({report});
    bytes.insert(bytes.end(), frame.begin(), frame.end());
  };
  add(reports[0]);
  bytes.insert(bytes.end(), {'x', 'y'});
  add(reports[1]);
  add(reports[2]);
  FalconFrameFinder finder;
  EXPECT_EQ(Found(finder, bytes), reports);
  EXPECT_EQ(finder.corrupt_frames(), 2u);
}

// The frame after a broken one is whole, whichever byte was lost, doubled or changed.
TEST(FalconFrames, OneBrokenByteCostsOneFrame) {
  const auto reports = SomeReports(3);
  const Bytes good = Joined(reports);
  for (std::size_t at = 16; at < 32; ++at) {
    for (int kind = 0; kind < 3; ++kind) {
      if (kind == 1 && at == 16) continue;  // between frames: as above
      Bytes bytes = good;
      const auto place = bytes.begin() + static_cast<std::ptrdiff_t>(at);
      if (kind == 0) bytes.erase(place);
      if (kind == 1) bytes.insert(place, 'A');
      if (kind == 2) *place = 0x00;
      FalconFrameFinder finder;
      const auto found = Found(finder, bytes);
      ASSERT_GE(found.size(), 2u);
      EXPECT_EQ(found.front(), reports[0]);
      EXPECT_EQ(found.back(), reports[2]);
      // The byte without a meaning may be changed.
      EXPECT_EQ(finder.corrupt_frames(), found.size() == 3 ? 0u : 1u) << at << " " << kind;
      EXPECT_TRUE(found.size() == 2 || (at == 30 && kind == 2)) << at << " " << kind;
    }
  }
}

TEST(FalconFrames, RandomBytesNeverCostAFrameBehindThem) {
  std::mt19937 random(2);
  const auto reports = SomeReports(1);
  for (int n = 0; n < test::Scaled(20'000); ++n) {
    Bytes bytes(random() % 40);
    // Mostly of the alphabet of frames.
    for (auto& byte : bytes) {
      byte = static_cast<std::uint8_t>(n % 2 == 0 ? random() : "<>ABOP"[random() % 6]);
    }
    FalconFrameFinder finder;
    Found(finder, bytes);
    const auto found = Found(finder, Joined(reports));
    ASSERT_EQ(found, reports);
  }
}

TEST(FalconFrames, FramesSplitOverTransfersAreFound) {
  const auto reports = SomeReports(200);
  const Bytes bytes = Joined(reports);
  std::mt19937 random(3);
  for (int n = 0; n < 200; ++n) {
    FalconFrameFinder finder;
    std::vector<FalconReport> found;
    for (std::size_t at = 0; at < bytes.size();) {
      const std::size_t size = std::min<std::size_t>(1 + random() % 300, bytes.size() - at);
      const auto begin = bytes.begin() + static_cast<std::ptrdiff_t>(at);
      const Bytes transfer = AsTransfer(Bytes(begin, begin + static_cast<std::ptrdiff_t>(size)));
      ForEachFtdiByte(transfer, [&](std::uint8_t byte) {
        if (finder.Push(byte)) found.push_back(*DecodeFalconReport(finder.frame()));
      });
      at += size;
    }
    ASSERT_EQ(found, reports);
    ASSERT_EQ(finder.corrupt_frames(), 0u);
  }
  // Nothing but the chip's status: an empty packet, and halves of it.
  const Bytes status(kFtdiPacketBytes, '<');
  for (std::size_t size = 0; size <= kFtdiStatusBytes; ++size) {
    ForEachFtdiByte(std::span(status).first(size), [](std::uint8_t) { FAIL(); });
  }
}

}  // namespace
}  // namespace palpate
