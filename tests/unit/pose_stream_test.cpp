// What a subscriber gets: rate, batches, newest wins, the window.
#include "server/rpc/pose_stream.h"
#include "common/contract/enumerations.h"

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

TEST(PoseSample, LeavesOutWhatIsAbsent) {
  TickSample sample;
  EXPECT_FALSE(ToProto(sample).has_scp_v_mm());
  EXPECT_FALSE(ToProto(sample).has_scp_h_normal());
  sample.contact = true;
  sample.has_scp_v = true;
  sample.mode = ProxyMode::kConstrained;
  sample.scp_v_mm = {1, 2, 3};
  const v1::PoseSample message = ToProto(sample);
  EXPECT_EQ(message.scp_v_mm().z(), 3.0);
  EXPECT_TRUE(message.has_scp_h_normal());
  EXPECT_EQ(message.mode(), v1::PROXY_MODE_CONSTRAINED);
}

TEST(PoseSample, EveryStateAndReasonOfForcesHasItsOwnOnTheWire) {
  TickSample sample;
  sample.force_limit_n = 1.25;
  for (int n = 1; n <= static_cast<int>(ForceState::kStopped); ++n) {
    sample.force_state = static_cast<ForceState>(n);
    EXPECT_EQ(ToProto(sample).forces().state(), n);
  }
  for (int n = 1; n <= static_cast<int>(ForceReason::kStopButton); ++n) {
    sample.force_reason = static_cast<ForceReason>(n);
    EXPECT_EQ(ToProto(sample).forces().reason(), n);
  }
  EXPECT_EQ(ToProto(sample).forces().limit_n(), 1.25);
}

// What the safety stage would let through does not come, either: its input is zero.
TEST(PoseSample, NothingActsInAReplay) {
  TickSample sample;
  sample.force_state = ForceState::kOn;
  sample.force_reason = ForceReason::kNone;
  EXPECT_FALSE(ToProto(sample).replayed());
  sample.replayed = true;
  EXPECT_TRUE(ToProto(sample).replayed());
  for (const ForceState state : {ForceState::kOn, ForceState::kRampIn}) {
    sample.force_state = state;
    EXPECT_EQ(ToProto(sample).forces().state(), v1::FORCE_STATE_HELD);
    EXPECT_EQ(ToProto(sample).forces().reason(), v1::FORCE_REASON_REPLAY);
  }
  // The other states outlast the replay.
  sample.force_state = ForceState::kStopped;
  sample.force_reason = ForceReason::kStopCall;
  EXPECT_EQ(ToProto(sample).forces().state(), v1::FORCE_STATE_STOPPED);
  EXPECT_EQ(ToProto(sample).forces().reason(), v1::FORCE_REASON_STOP_CALL);
}

TEST(PoseSample, EveryModeHasItsOwnOnTheWire) {
  TickSample sample;
  for (const auto& [mode, name] : {std::pair{ProxyMode::kFree, v1::PROXY_MODE_FREE},
                                   {ProxyMode::kConstrained, v1::PROXY_MODE_CONSTRAINED},
                                   {ProxyMode::kEjecting, v1::PROXY_MODE_EJECTING},
                                   {ProxyMode::kFault, v1::PROXY_MODE_FAULT},
                                   {ProxyMode::kSuspended, v1::PROXY_MODE_SUSPENDED},
                                   {ProxyMode::kInside, v1::PROXY_MODE_INSIDE}}) {
    sample.mode = mode;
    EXPECT_EQ(ToProto(sample).mode(), name);
  }
}

}  // namespace
}  // namespace palpate
