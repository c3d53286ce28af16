// What a subscriber gets: rate, batches, newest wins, the window.
#include "common/contract/enumerations.h"
#include "server/pump/pose_of.h"
#include "server/services/pose_service.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "common/error/error.h"

namespace palpate {
namespace {

TickSample Sample(std::uint64_t tick, std::uint64_t missed = 0) {
  TickSample sample;
  sample.tick = tick;
  sample.missed_ticks = missed;
  return sample;
}

PoseStreamOptions Options(double rate_hz, std::uint32_t batch, int window = 0) {
  v1::StreamPosesStart start;
  start.set_rate_hz(rate_hz);
  start.set_batch(batch);
  if (window > 0) start.set_max_unacknowledged(static_cast<std::uint32_t>(window));
  return ParsePoseStreamOptions(start);
}

TEST(PoseStreamOptions, HaveDefaultsAndLimits) {
  EXPECT_EQ(Options(0, 0, 4).ticks_per_sample, 17u);
  EXPECT_EQ(Options(0, 0, 4).batch, 1u);
  EXPECT_EQ(Options(1000, 16, 4).ticks_per_sample, 1u);
  EXPECT_THROW(Options(-1, 1), Error);
  EXPECT_THROW(Options(1001, 1), Error);
  EXPECT_THROW(Options(60, 257), Error);
  EXPECT_THROW(Options(60, 1, 65), Error);
  v1::StreamPosesStart zero_window;
  zero_window.set_max_unacknowledged(0);
  EXPECT_THROW(ParsePoseStreamOptions(zero_window), Error);
}

TEST(PoseStreamOptions, KnowOneHand) {
  v1::StreamPosesStart start;
  start.add_hands(0);
  start.set_all_hands(true);
  ParsePoseStreamOptions(start);
  start.add_hands(1);
  EXPECT_THROW(ParsePoseStreamOptions(start), Error);
}

TEST(PoseStreamOptions, APlainStreamHasAtMostHundredMessagesPerSecond) {
  for (double rate_hz : {1.0, 60.0, 100.0, 250.0, 333.0, 1000.0}) {
    const PoseStreamOptions options = Options(rate_hz, 1);
    const double messages = 1000.0 / static_cast<double>(options.ticks_per_sample * options.batch);
    EXPECT_LE(messages, 100.0) << rate_hz;
  }
}

TEST(PoseStreamOptions, CostWhatIsSampledNotWhatWasAskedFor) {
  EXPECT_EQ(SamplesPerSecond(Options(1000, 1, 4)), 1000);
  EXPECT_EQ(SamplesPerSecond(Options(1000, 256)), 1000);
  EXPECT_EQ(SamplesPerSecond(Options(667, 1, 4)), 1000);  // every tick
  EXPECT_EQ(SamplesPerSecond(Options(60, 1, 4)), 59);
  EXPECT_EQ(SamplesPerSecond(Options(0, 0)), 59);
  EXPECT_EQ(SamplesPerSecond(Options(1e-9, 1)), 1);
}

TEST(PoseStream, SamplesInLoopTimeWhateverIsMissed) {
  PoseStream stream(Options(100, 3, 8));
  std::vector<std::uint64_t> times;
  std::uint64_t missed = 0, tick = 0;
  for (std::uint64_t time = 0; time < 60; ++time) {
    if (time == 20 || time == 25) {  // two ticks are missed, one of them due
      ++missed;
      continue;
    }
    stream.Add(Sample(tick++, missed));
    if (!stream.HasMessage()) continue;
    const v1::StreamPosesResponse message = stream.TakeMessage(5);
    for (const auto& sample : message.samples()) {
      times.push_back(sample.tick() + sample.missed_ticks());
    }
  }
  EXPECT_EQ(times, (std::vector<std::uint64_t>{0, 10, 21, 30, 40, 50}));
}

TEST(PoseStream, NewestWinsAndLossesAreCounted) {
  PoseStream stream(Options(1000, 2, 1));
  for (std::uint64_t tick = 0; tick < 10; ++tick) stream.Add(Sample(tick));
  ASSERT_TRUE(stream.HasMessage());
  v1::StreamPosesResponse message = stream.TakeMessage(1);
  EXPECT_EQ(message.message_number(), 1u);
  EXPECT_EQ(message.dropped_samples(), 8u);
  ASSERT_EQ(message.samples_size(), 2);
  EXPECT_EQ(message.samples(0).tick(), 8u);
  // One message is not acknowledged: no more.
  for (std::uint64_t tick = 10; tick < 20; ++tick) stream.Add(Sample(tick));
  EXPECT_FALSE(stream.HasMessage());
  stream.Acknowledge(1);
  ASSERT_TRUE(stream.HasMessage());
  message = stream.TakeMessage(2);
  EXPECT_EQ(message.samples(1).tick(), 19u);
  EXPECT_EQ(message.dropped_samples(), 16u);
}

TEST(PoseStream, WhatWaitsIsNotLost) {
  v1::StreamPosesStart start;
  start.set_rate_hz(1000);
  start.set_batch(2);
  start.set_max_unacknowledged(1);
  start.set_waiting(5);
  PoseStream stream(ParsePoseStreamOptions(start));
  for (std::uint64_t tick = 0; tick < 6; ++tick) stream.Add(Sample(tick));
  for (const std::uint64_t number : {1, 2}) {
    ASSERT_TRUE(stream.HasMessage());
    const v1::StreamPosesResponse message = stream.TakeMessage(1);
    ASSERT_EQ(message.samples_size(), 2);
    EXPECT_EQ(message.samples(0).tick(), 2 * number - 1);
    EXPECT_EQ(message.dropped_samples(), 1u);  // the sixth waited in vain
    stream.Acknowledge(number);
  }
  EXPECT_FALSE(stream.HasMessage());  // half a batch
  start.set_waiting(4'000'000'000);
  EXPECT_EQ(ParsePoseStreamOptions(start).waiting, 5000u);  // 5 s
}

TEST(PoseStream, AForgedAcknowledgementOpensNothing) {
  PoseStream stream(Options(1000, 1, 1));
  stream.Add(Sample(0));
  stream.TakeMessage(1);
  stream.Acknowledge(1000);
  stream.Add(Sample(1));
  stream.TakeMessage(2);
  stream.Add(Sample(2));
  EXPECT_FALSE(stream.HasMessage());
}

TEST(PoseSample, HasTheFieldsOfTheTick) {
  TickSample sample;
  sample.tick = 1;
  sample.time_ns = 2;
  sample.hip_mm = {3, 4, 5};
  sample.scp_h_mm = {6, 7, 8};
  sample.stylus_orientation = {9, 10, 11, 12};
  sample.buttons = 13;
  sample.force_n = {14, 15, 16};
  sample.mode = ProxyMode::kEjecting;
  sample.density = 17;
  sample.isovalue = 18;
  sample.settings_revision = 19;
  sample.volume_revision = 20;
  sample.update_ns = 21;
  sample.missed_ticks = 22;
  sample.iterations = 23;
  sample.capped_ticks = 24;
  sample.free_side = FreeSide::kAbove;
  sample.force_state = ForceState::kHeld;
  sample.force_reason = ForceReason::kStale;
  sample.force_limit_n = 25;
  sample.refinement = 26;
  sample.layers_passed = 27;
  sample.contact_layer = 28;
  sample.tool_radius_mm = 29;
  sample.hand = 30;
  sample.torque_n_mm = {31, 32, 33};
  sample.torque_limit_n_mm = 34;
  EXPECT_EQ(PoseOf(sample), (PoseSample{.tick = 1,
                                        .time_ns = 2,
                                        .hip_mm = Vec3(3, 4, 5),
                                        .scp_h_mm = Vec3(6, 7, 8),
                                        .stylus_orientation = {9, 10, 11, 12},
                                        .buttons = 13,
                                        .force_n = Vec3(14, 15, 16),
                                        .mode = ProxyMode::kEjecting,
                                        .density = 17,
                                        .isovalue = 18,
                                        .settings_revision = 19,
                                        .volume_revision = 20,
                                        .update_ns = 21,
                                        .missed_ticks = 22,
                                        .iterations = 23,
                                        .capped_ticks = 24,
                                        .free_side = FreeSide::kAbove,
                                        .forces = {ForceState::kHeld, ForceReason::kStale, 25, 34},
                                        .refinement = 26,
                                        .layers_passed = 27,
                                        .contact_layer = 28,
                                        .tool_radius_mm = 29,
                                        .hand = 30,
                                        .torque_n_mm = Vec3(31, 32, 33)}));
}

TEST(PoseSample, LeavesOutWhatIsAbsent) {
  TickSample sample;
  EXPECT_FALSE(PoseOf(sample).scp_v_mm);
  EXPECT_FALSE(PoseOf(sample).scp_h_normal);
  sample.contact = true;
  sample.has_scp_v = true;
  sample.scp_v_mm = {1, 2, 3};
  EXPECT_EQ(PoseOf(sample).scp_v_mm, Vec3(1, 2, 3));
  EXPECT_TRUE(PoseOf(sample).scp_h_normal);
}

// What the safety stage would let through does not come, either: its input is zero.
TEST(PoseSample, NothingActsInAReplay) {
  TickSample sample;
  sample.force_state = ForceState::kOn;
  sample.force_reason = ForceReason::kNone;
  EXPECT_FALSE(PoseOf(sample).replayed);
  sample.replayed = true;
  EXPECT_TRUE(PoseOf(sample).replayed);
  for (const ForceState state : {ForceState::kOn, ForceState::kRampIn}) {
    sample.force_state = state;
    EXPECT_EQ(PoseOf(sample).forces.state, ForceState::kHeld);
    EXPECT_EQ(PoseOf(sample).forces.reason, ForceReason::kReplay);
  }
  // The other states outlast the replay.
  sample.force_state = ForceState::kStopped;
  sample.force_reason = ForceReason::kStopCall;
  EXPECT_EQ(PoseOf(sample).forces.state, ForceState::kStopped);
  EXPECT_EQ(PoseOf(sample).forces.reason, ForceReason::kStopCall);
}

}  // namespace
}  // namespace palpate
