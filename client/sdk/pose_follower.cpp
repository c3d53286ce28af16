#include "client/sdk/pose_follower.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/wire/values.h"

namespace palpate::client {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

// The most messages on their way: enough that a pause of the machine loses nothing. After a slow
// callback, all of them form one batch, so that the callback sees fresh poses.
constexpr std::uint32_t kFollowWindow = 16;
// The messages on their way, one that waits at the daemon, and one that arrives meanwhile.
constexpr int kMostMerged = kFollowWindow + 2;
constexpr milliseconds kSlow{5};        // callback time behind which messages may pile up
constexpr milliseconds kPileWait{1};    // for the next message of the pile, which is on its way
constexpr milliseconds kPosePoll{50};   // how often to look for the end and for another rate
constexpr milliseconds kSilence{2000};  // afterwards, ask palpated whether it still runs
constexpr milliseconds kProbeTimeout{3000};
constexpr milliseconds kKeepStop{1000};
constexpr double kBatchS = 0.010;
constexpr double kLongestBatchS = 0.050;

v1::StreamPosesRequest Start(const PoseRate& rate) {
  v1::StreamPosesRequest request;
  request.mutable_start()->set_rate_hz(rate.rate_hz);
  request.mutable_start()->set_batch(static_cast<std::uint32_t>(BatchOf(rate)));
  request.mutable_start()->set_max_unacknowledged(kFollowWindow);
  return request;
}

}  // namespace

int BatchOf(const PoseRate& rate) {
  if (!(rate.rate_hz >= 20.0 && rate.rate_hz <= 1000.0)) {
    throw Error(ErrorKind::kInvalidArgument, "the rate of poses is 20 to 1000 Hz");
  }
  const int most = std::min(256, static_cast<int>(rate.rate_hz * kLongestBatchS + 1e-9));
  if (rate.batch < 0 || rate.batch > most) {
    throw Error(ErrorKind::kInvalidArgument,
                "a batch of poses is 50 ms of them at most, at this rate " + std::to_string(most));
  }
  if (rate.batch > 0) return rate.batch;
  return std::max(1, static_cast<int>(rate.rate_hz * kBatchS + 1e-9));
}

PoseFollower::PoseFollower(Link& link, Monitor& monitor, const PoseRate& rate, Events events)
    : link_(link), monitor_(monitor), events_(std::move(events)), rate_(rate) {
  BatchOf(rate);
}

void PoseFollower::Begin() {
  thread_ = std::thread([this] { Run(); });
}

void PoseFollower::End() {
  if (thread_.joinable()) thread_.join();
}

std::optional<Pose> PoseFollower::Newest() const {
  const std::lock_guard lock(mutex_);
  return newest_;
}

void PoseFollower::SetRate(const PoseRate& rate) {
  BatchOf(rate);
  const std::lock_guard lock(mutex_);
  rate_ = rate;
  ++rate_number_;
}

void PoseFollower::Run() {
  while (!monitor_.stopping()) {
    try {
      Follow();
    } catch (const Error& error) {
      if (monitor_.stopping()) return;
      Report({ConnectionState::kLost, error.what()});
      monitor_.Pause(backoff_.Next());
    }
  }
}

void PoseFollower::Follow() {
  link_.Renew();
  kept_stop_ = {};
  const std::unique_ptr<v1::PoseService::Stub> stub = v1::PoseService::NewStub(link_.channel());
  events_.first_settings(AskForSettings());
  Report({ConnectionState::kConnected, {}});
  while (!monitor_.stopping()) {
    std::unique_lock lock(mutex_);
    const PoseRate rate = rate_;
    const int rate_number = rate_number_;
    lock.unlock();
    Call call(Start(rate), [&stub](auto* context, auto* queue) {
      return stub->PrepareAsyncStreamPoses(context, queue);
    });
    dropped_before_ = dropped_;
    Read(call, rate_number);
  }
}

v1::GetSettingsResponse PoseFollower::AskForSettings() {
  return link_.Call<v1::RenderService>(&v1::RenderService::Stub::GetSettings,
                                       v1::GetSettingsRequest(), kProbeTimeout);
}

void PoseFollower::Read(Call& call, int rate_number) {
  v1::StreamPosesResponse message;
  auto heard = Clock::now();
  while (!monitor_.stopping() && rate_number == rate_number_) {
    if (Clock::now() - kept_stop_ > kKeepStop) {
      link_.KeepStopReady();
      kept_stop_ = Clock::now();
    }
    switch (call.Next(kPosePoll, message)) {
      case CallEvent::kMessage:
        backoff_.Reset();
        TakeAll(call, message);
        heard = Clock::now();
        break;
      case CallEvent::kTimeout:
        if (Clock::now() - heard < kSilence) break;
        // A silent stream has two causes: the loop stands still, or the daemon is gone. A daemon
        // that is gone does not answer this call.
        AskForSettings();
        heard = Clock::now();
        break;
      case CallEvent::kEnded:
        throw call.status().ok() ? Error(ErrorKind::kUnavailable, "palpated ended the stream")
                                 : link_.ErrorOf(call.status());
    }
  }
}

void PoseFollower::TakeAll(Call& call, v1::StreamPosesResponse& message) {
  PoseBatch batch;
  Add(message, batch);
  for (int n = 1; is_slow_ && n < kMostMerged; ++n) {
    if (call.Next(kPileWait, message) != CallEvent::kMessage) break;
    Add(message, batch);
  }
  if (batch.poses.empty()) return;
  dropped_ = batch.dropped;
  {
    const std::lock_guard lock(mutex_);
    newest_ = batch.poses.back();
  }
  if (!events_.poses) return;
  events_.poses(batch);
  is_slow_ = Clock::now() - batch.received > kSlow;
}

void PoseFollower::Add(const v1::StreamPosesResponse& message, PoseBatch& batch) const {
  for (const v1::PoseSample& sample : message.samples()) {
    batch.poses.push_back(palpate::FromProto(sample));
  }
  batch.dropped = dropped_before_ + message.dropped_samples();
  batch.sent_time_ns = message.sent_time_ns();
  batch.received = Clock::now();
}

void PoseFollower::Report(const Connection& connection) {
  if (monitor_.Set(connection) && events_.connection) events_.connection(connection);
}

}  // namespace palpate::client
