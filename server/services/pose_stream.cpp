#include "server/services/pose_stream.h"

#include <algorithm>
#include <cmath>

#include "common/error/error.h"
#include "common/wire/values.h"
#include "server/pump/pose_of.h"

namespace palpate {
namespace {

constexpr double kTickRateHz = 1000.0;
constexpr double kDefaultRateHz = 60.0;
constexpr std::uint32_t kMaxBatch = 256;
constexpr std::uint32_t kMaxUnacknowledged = 64;
constexpr double kMostWaitingS = 5.0;
// Without acknowledgements, the transport's buffer would let a slow client fall further and further
// behind. Fewer messages limit this delay.
constexpr double kMaxPlainMessagesPerSecond = 100.0;

}  // namespace

PoseStreamOptions ParsePoseStreamOptions(const v1::StreamPosesStart& start) {
  const double rate_hz = start.rate_hz() == 0.0 ? kDefaultRateHz : start.rate_hz();
  if (!(rate_hz > 0.0 && rate_hz <= kTickRateHz)) {
    throw Error(ErrorKind::kInvalidArgument, "rate_hz must be above 0 and at most 1000");
  }
  if (start.batch() > kMaxBatch) {
    throw Error(ErrorKind::kInvalidArgument, "batch must be at most 256");
  }
  if (std::ranges::any_of(start.hands(), [](std::uint32_t hand) { return hand != 0; })) {
    throw Error(ErrorKind::kInvalidArgument, "the daemon has one hand, 0");
  }
  PoseStreamOptions options;
  options.ticks_per_sample =
      static_cast<std::uint64_t>(std::max(1.0, std::round(std::min(kTickRateHz / rate_hz, 1e9))));
  options.batch = std::max(1u, start.batch());
  if (start.has_max_unacknowledged()) {
    if (start.max_unacknowledged() < 1 || start.max_unacknowledged() > kMaxUnacknowledged) {
      throw Error(ErrorKind::kInvalidArgument, "max_unacknowledged must be from 1 to 64");
    }
    options.max_unacknowledged = start.max_unacknowledged();
    const auto most_waiting =
        static_cast<std::size_t>(kMostWaitingS * kTickRateHz) / options.ticks_per_sample;
    options.waiting = std::min<std::size_t>(start.waiting(), most_waiting);
  } else {
    const double samples_per_second = kTickRateHz / static_cast<double>(options.ticks_per_sample);
    const double least = std::ceil(samples_per_second / kMaxPlainMessagesPerSecond);
    options.batch = std::max(options.batch, static_cast<std::size_t>(least));
  }
  options.waiting = std::max(options.waiting, options.batch);
  return options;
}

int SamplesPerSecond(const PoseStreamOptions& options) {
  return static_cast<int>(std::ceil(kTickRateHz / static_cast<double>(options.ticks_per_sample)));
}

void PoseStream::Add(const TickSample& sample) {
  const std::uint64_t now = sample.tick + sample.missed_ticks;
  if (next_tick_ && now < *next_tick_) return;
  // Missed ticks do not shift the later samples.
  const std::uint64_t step = options_.ticks_per_sample;
  next_tick_ = next_tick_ ? *next_tick_ + step * ((now - *next_tick_) / step + 1) : now + step;
  waiting_.push_back(sample);
  if (waiting_.size() > options_.waiting) {
    waiting_.pop_front();
    ++dropped_;
  }
}

void PoseStream::Acknowledge(std::uint64_t message_number) {
  acknowledged_ = std::max(acknowledged_, std::min(message_number, sent_));
}

bool PoseStream::HasMessage() const {
  const bool open =
      !options_.max_unacknowledged || sent_ - acknowledged_ < *options_.max_unacknowledged;
  return open && waiting_.size() >= options_.batch;
}

v1::StreamPosesResponse PoseStream::TakeMessage(std::int64_t now_ns) {
  v1::StreamPosesResponse message;
  message.set_message_number(++sent_);
  message.set_dropped_samples(dropped_);
  message.set_sent_time_ns(now_ns);
  for (std::size_t n = 0; n < options_.batch; ++n) {
    *message.add_samples() = ToProto(PoseOf(waiting_.front()));
    waiting_.pop_front();
  }
  return message;
}

}  // namespace palpate
