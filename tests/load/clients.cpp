#include "tests/load/clients.h"

#include <chrono>
#include <random>
#include <utility>

#include "common/wire/values.h"
#include "palpate/v1/render.grpc.pb.h"
#include "palpate/v1/volume.grpc.pb.h"
#include "server/realtime/tick_timer.h"

namespace palpate::load {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::seconds kPatience{10};
// After a stop of the machine the calls that it held up are not all made at once.
constexpr std::chrono::milliseconds kLongestBacklog{200};

void SetDeadline(grpc::ClientContext& context) {
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
}

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

SteadyCaller::SteadyCaller(double rate_hz, std::function<grpc::Status(std::uint64_t)> call)
    : rate_hz_(rate_hz), call_(std::move(call)), thread_([this] { Run(); }) {}

void SteadyCaller::Stop() {
  stop_ = true;
  if (thread_.joinable()) thread_.join();
}

void SteadyCaller::Run() {
  const auto period =
      std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1.0 / rate_hz_));
  auto next = Clock::now();
  while (!stop_) {
    const grpc::Status status = call_(calls_++);
    if (!status.ok()) error_ = status.error_message();
    next = std::max(next + period, Clock::now() - kLongestBacklog);
    std::this_thread::sleep_until(next);
  }
}

std::function<grpc::Status(std::uint64_t)> SettingsCalls(const std::string& target) {
  std::shared_ptr<v1::RenderService::Stub> stub =
      v1::RenderService::NewStub(grpc::CreateChannel(target, grpc::InsecureChannelCredentials()));
  return [stub](std::uint64_t n) {
    grpc::ClientContext context;
    SetDeadline(context);
    v1::UpdateSettingsRequest request;
    const double step = static_cast<double>(n / 2 % 10);
    if (n % 2 == 0) {
      request.mutable_settings()->set_stiffness_n_per_mm(0.45 + 0.01 * step);
      request.mutable_update_mask()->add_paths("stiffness_n_per_mm");
    } else {
      request.mutable_settings()->set_normalized_isovalue(0.495 + 0.001 * step);
      request.mutable_update_mask()->add_paths("normalized_isovalue");
    }
    v1::UpdateSettingsResponse response;
    return stub->UpdateSettings(&context, request, &response);
  };
}

std::function<grpc::Status(std::uint64_t)> EditCalls(const std::string& target, int edge,
                                                     unsigned seed) {
  std::shared_ptr<v1::VolumeService::Stub> stub =
      v1::VolumeService::NewStub(grpc::CreateChannel(target, grpc::InsecureChannelCredentials()));
  auto random = std::make_shared<std::mt19937>(seed);
  return [stub, random, edge](std::uint64_t) {
    std::uniform_real_distribution<double> place(0.0, edge - 1.0), amount(-0.05, 0.05);
    v1::EditVolumeRequest request;
    request.set_frame(v1::EDIT_FRAME_INDEX);
    request.set_operation(v1::EDIT_OPERATION_ADD);
    request.set_value(amount(*random));
    request.set_falloff(3.0);
    *request.mutable_sphere() =
        ToProto(SphereShape{Vec3{place(*random), place(*random), place(*random)}, 5.0});
    grpc::ClientContext context;
    SetDeadline(context);
    v1::EditVolumeResponse response;
    return stub->EditVolume(&context, request, &response);
  };
}

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
