#include "server/rpc/pose_stream.h"

#include <algorithm>
#include <cmath>

#include "common/error/error.h"
#include "common/wire/convert.h"
#include "server/rpc/device_messages.h"
#include "server/rpc/render_service.h"

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

void SetVector(v1::Vector3* out, const std::array<double, 3>& v) {
  out->set_x(v[0]);
  out->set_y(v[1]);
  out->set_z(v[2]);
}

}  // namespace

PoseStreamOptions ParsePoseStreamOptions(const v1::StreamPosesStart& start) {
  const double rate_hz = start.rate_hz() == 0.0 ? kDefaultRateHz : start.rate_hz();
  if (!(rate_hz > 0.0 && rate_hz <= kTickRateHz)) {
    throw Error(ErrorKind::kInvalidArgument, "rate_hz must be above 0 and at most 1000");
  }
  if (start.batch() > kMaxBatch) {
    throw Error(ErrorKind::kInvalidArgument, "batch must be at most 256");
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
    *message.add_samples() = palpate::ToProto(waiting_.front());
    waiting_.pop_front();
  }
  return message;
}

v1::PoseSample ToProto(const TickSample& sample) {
  v1::PoseSample out;
  out.set_tick(sample.tick);
  out.set_time_ns(sample.time_ns);
  SetVector(out.mutable_hip_mm(), sample.hip_mm);
  SetVector(out.mutable_scp_h_mm(), sample.scp_h_mm);
  if (sample.contact) SetVector(out.mutable_scp_h_normal(), sample.scp_h_normal);
  if (sample.has_scp_v) {
    SetVector(out.mutable_scp_v_mm(), sample.scp_v_mm);
    SetVector(out.mutable_scp_v_normal(), sample.scp_v_normal);
  }
  v1::Quaternion* orientation = out.mutable_stylus_orientation();
  orientation->set_w(sample.stylus_orientation[0]);
  orientation->set_x(sample.stylus_orientation[1]);
  orientation->set_y(sample.stylus_orientation[2]);
  orientation->set_z(sample.stylus_orientation[3]);
  out.set_buttons(sample.buttons);
  SetVector(out.mutable_force_n(), sample.force_n);
  out.set_mode(static_cast<v1::ProxyMode>(sample.mode));
  out.set_contact(sample.contact);
  out.set_density(sample.density);
  out.set_isovalue(sample.isovalue);
  out.set_settings_revision(sample.settings_revision);
  out.set_volume_revision(sample.volume_revision);
  out.set_update_ns(sample.update_ns);
  out.set_missed_ticks(sample.missed_ticks);
  out.set_iterations(sample.iterations);
  out.set_capped_ticks(sample.capped_ticks);
  out.set_free_side(static_cast<v1::FreeSide>(sample.free_side));
  *out.mutable_forces() = palpate::ToProto(sample.force_state, sample.force_reason,
                                           sample.force_limit_n, sample.replayed);
  out.set_replayed(sample.replayed);
  return out;
}

}  // namespace palpate
