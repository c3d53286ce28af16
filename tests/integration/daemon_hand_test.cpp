// The simulated hand of a real daemon finds what is thin: a tube of two voxels, which a hand that
// searches by touch alone meets once in minutes.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tests/support/daemon.h"
#include "tests/support/nrrd.h"
#include "tests/support/places.h"

namespace palpate::test {
namespace {

constexpr std::size_t kSamples = 4000;  // four seconds of a servo that misses no tick
constexpr double kLeastShare = 0.6;

float VesselAt(int i, int j, int k) {
  const double x = 48.0 + 30.0 * std::sin(0.07 * k), y = 48.0 + 30.0 * std::cos(0.045 * k);
  const double away = std::hypot(i - x, j - y);
  return static_cast<float>(std::clamp(1.5 - 0.6 * away, 0.0, 1.0));
}

// Of the first samples from the first contact on.
double ContactShare(Daemon& daemon) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
  const auto stream = daemon.poses->StreamPoses(&context);
  v1::StreamPosesRequest request;
  request.mutable_start()->set_rate_hz(1000);
  request.mutable_start()->set_batch(16);
  request.mutable_start()->set_max_unacknowledged(8);
  stream->Write(request);
  std::size_t samples = 0, contacts = 0;
  for (v1::StreamPosesResponse message; samples < kSamples && stream->Read(&message);) {
    for (const v1::PoseSample& sample : message.samples()) {
      contacts += sample.contact();
      samples += contacts > 0;
    }
    request.mutable_acknowledgement()->set_message_number(message.message_number());
    stream->Write(request);
  }
  context.TryCancel();
  stream->Finish();
  EXPECT_GE(samples, kSamples);
  const double share = static_cast<double>(contacts) / static_cast<double>(samples);
  std::printf("%zu of %zu samples in contact\n", contacts, samples);
  return share;
}

TEST(DaemonHand, TouchesAThinVesselMostOfTheTime) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "vessel.nrrd";
  palpate::testing::WriteNrrd(file, Vec3i::Constant(96), VesselAt);
  Daemon daemon(kPalpated, {"--volume", file, "--isovalue", "0.5"});
  EXPECT_GE(ContactShare(daemon), kLeastShare);

  // The vessel is somewhere else, many times its width from where it was: another plan.
  v1::UpdateRegistrationRequest update;
  update.mutable_translate_mm()->set_x(15.0);
  grpc::ClientContext context;
  v1::UpdateRegistrationResponse updated;
  ASSERT_TRUE(daemon.registration->UpdateRegistration(&context, update, &updated).ok());
  EXPECT_GE(ContactShare(daemon), kLeastShare);
}

}  // namespace
}  // namespace palpate::test
