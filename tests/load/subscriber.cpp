#include "tests/load/subscriber.h"

#include "server/realtime/tick_timer.h"

namespace palpate::load {
namespace {

std::shared_ptr<grpc::Channel> OwnConnection(const std::string& target) {
  grpc::ChannelArguments arguments;
  // Or gRPC would let all channels of this process share one connection.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return grpc::CreateCustomChannel(target, grpc::InsecureChannelCredentials(), arguments);
}

bool IsContactFault(const v1::PoseSample& sample) {
  if (sample.mode() != v1::PROXY_MODE_FREE && sample.mode() != v1::PROXY_MODE_CONSTRAINED) {
    return false;
  }
  return sample.free_side() == v1::FREE_SIDE_ABOVE ? sample.density() < sample.isovalue()
                                                   : sample.density() > sample.isovalue();
}

}  // namespace

Subscriber::Subscriber(const std::string& target, const SubscriberKind& kind)
    : kind_(kind), channel_(OwnConnection(target)), stub_(v1::PoseService::NewStub(channel_)) {
  request_.mutable_start()->set_rate_hz(kind.rate_hz);
  request_.mutable_start()->set_batch(kind.batch);
  request_.mutable_start()->set_max_unacknowledged(kind.max_unacknowledged);
  stub_->async()->StreamPoses(&context_, this);
  StartWrite(&request_);
  StartRead(&message_);
  StartCall();
}

void Subscriber::Stop() {
  std::unique_lock lock(mutex_);
  stopping_ = true;
  if (!done_) context_.TryCancel();
  ended_.wait(lock, [this] { return done_; });
}

std::size_t Subscriber::received_so_far() const {
  const std::lock_guard lock(mutex_);
  return received_.size();
}

bool Subscriber::has_ended() const {
  const std::lock_guard lock(mutex_);
  return done_;
}

std::int64_t Subscriber::newest_ns() const {
  const std::lock_guard lock(mutex_);
  return received_.empty() ? 0 : received_.back().time_ns;
}

void Subscriber::Take(const v1::StreamPosesResponse& message) {
  for (const v1::PoseSample& sample : message.samples()) {
    received_.push_back({sample.tick() + sample.missed_ticks(), sample.missed_ticks(),
                         sample.time_ns(), sample.update_ns(), IsContactFault(sample)});
  }
  ages_ns_.push_back(MonotonicNowNs() - message.samples().rbegin()->time_ns());
  dropped_ = message.dropped_samples();
  newest_ = message.message_number();
}

void Subscriber::OnReadDone(bool ok) {
  {
    const std::lock_guard lock(mutex_);
    if (!ok) return;
    Take(message_);
    AcknowledgeIfPossible();
  }
  StartRead(&message_);
}

void Subscriber::OnWriteDone(bool ok) {
  const std::lock_guard lock(mutex_);
  writing_ = false;
  if (ok) AcknowledgeIfPossible();
}

void Subscriber::AcknowledgeIfPossible() {
  if (writing_ || acknowledged_ == newest_) return;
  acknowledged_ = newest_;
  request_.mutable_acknowledgement()->set_message_number(newest_);
  writing_ = true;
  StartWrite(&request_);
}

void Subscriber::OnDone(const grpc::Status& status) {
  const std::lock_guard lock(mutex_);
  if (!stopping_) error_ = status.error_message().empty() ? "ended" : status.error_message();
  done_ = true;
  // Under the lock: who waits may destroy this.
  ended_.notify_all();
}

}  // namespace palpate::load
