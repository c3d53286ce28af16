#include "client/sdk/followers.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "client/sdk/acknowledged_call.h"
#include "client/sdk/messages.h"
#include "common/wire/values.h"

namespace palpate::client {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kFactsWait{1000};
constexpr milliseconds kFactsPoll{50};  // how often to look for the end
// After a refusal, such as of too many streams.
constexpr int kPollsAfterRefusal = 20;

std::vector<const google::protobuf::FieldDescriptor*> FactsIn(const v1::Facts& facts) {
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  facts.GetReflection()->ListFields(facts, &fields);
  return fields;
}

}  // namespace

void FactsFollower::Begin() {
  thread_ = std::thread([this] { Run(); });
}

void FactsFollower::End() {
  if (thread_.joinable()) thread_.join();
}

std::shared_ptr<const Facts> FactsFollower::Newest() const {
  const std::lock_guard lock(mutex_);
  return newest_;
}

std::optional<Settings> FactsFollower::NewestSettings() const {
  const std::lock_guard lock(mutex_);
  return settings_;
}

void FactsFollower::Replace(const Settings& settings) {
  const std::lock_guard lock(mutex_);
  settings_ = settings;
  newest_ = std::make_shared<const Facts>();
}

void FactsFollower::Take(const Settings& settings, std::uint64_t epoch) {
  const std::lock_guard lock(mutex_);
  // An answer of an earlier daemon may have a higher revision.
  if (!monitor_.IsConnected(epoch)) return;
  if (!settings_ || settings_->revision < settings.revision) settings_ = settings;
}

void FactsFollower::Run() {
  while (!monitor_.stopping()) {
    const std::uint64_t epoch = monitor_.WaitUntilConnected(kFactsWait);
    if (epoch == 0) continue;
    try {
      Follow(epoch);
      monitor_.Pause(kFactsPoll);
    } catch (const Error& error) {
      // If the daemon is gone, the pose thread says so, and connects again.
      Put({.problem = error.what()}, epoch);
      for (int n = 0; n < kPollsAfterRefusal && monitor_.IsConnected(epoch); ++n) {
        monitor_.Pause(kFactsPoll);
      }
    }
  }
}

// Throws an Error if the daemon ends the stream. One that it cancels is of another role: the next
// one tells it.
void FactsFollower::Follow(std::uint64_t epoch) {
  const std::unique_ptr<v1::FactsService::Stub> stub = v1::FactsService::NewStub(link_.channel());
  v1::FollowRequest start;
  start.mutable_start();
  AcknowledgedCall<v1::FollowRequest, v1::FollowResponse> call(
      start, [&](auto* context, auto* queue) { return stub->PrepareAsyncFollow(context, queue); });
  Facts facts;
  v1::Facts all;
  v1::FollowResponse message;
  while (!monitor_.stopping() && monitor_.IsConnected(epoch)) {
    switch (call.Next(kFactsPoll, message)) {
      case CallEvent::kMessage:
        Merge(message.facts(), facts);
        for (const auto* fact : FactsIn(message.facts())) {
          all.GetReflection()->SwapFields(message.mutable_facts(), &all, {fact});
        }
        facts.message = all.SerializeAsString();
        Put(facts, epoch);
        break;
      case CallEvent::kTimeout:
        break;
      case CallEvent::kEnded:
        if (call.status().error_code() == grpc::StatusCode::CANCELLED) return;
        throw call.status().ok() ? Error(ErrorKind::kUnavailable, "palpated ended the stream")
                                 : link_.ErrorOf(call.status());
    }
  }
}

void FactsFollower::Merge(const v1::Facts& message, Facts& facts) {
  if (message.has_settings()) {
    const v1::SettingsState& state = message.settings();
    facts.settings =
        FromProto(state.settings(), state.settings_revision(), state.ball(), state.replayed());
  }
  if (message.has_volume()) facts.volume = FromProto(message.volume());
  if (message.has_placement()) facts.placement = FromProto(message.placement());
  if (message.has_series()) {
    facts.series.reset();
    if (message.series().frames() > 0) facts.series = FromProto(message.series());
  }
  if (message.has_recording()) facts.recording = FromProto(message.recording());
  if (message.has_hands()) facts.hands = FromProto(message.hands());
  if (message.has_activity()) {
    facts.activity = FromProto(message.activity());
    facts.activity_came = std::chrono::steady_clock::now();
  }
  if (message.has_caller()) facts.caller = FromProto(message.caller());
}

// Values from another connection are void.
void FactsFollower::Put(const Facts& facts, std::uint64_t epoch) {
  bool has_new_settings = false;
  {
    const std::lock_guard lock(mutex_);
    if (!monitor_.IsConnected(epoch)) return;
    const std::optional<Settings>& before = newest_->settings;
    // A call may have brought newer ones.
    has_new_settings = facts.settings &&
                       (!before || before->revision != facts.settings->revision) &&
                       (!settings_ || settings_->revision <= facts.settings->revision);
    if (has_new_settings) settings_ = facts.settings;
    newest_ = std::make_shared<const Facts>(facts);
  }
  if (has_new_settings && events_.settings) events_.settings(*facts.settings);
  if (events_.facts) events_.facts(facts);
}

namespace {

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

// Returns the batch to ask for. Errors: kInvalidArgument, as PoseRate says.
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

v1::StreamPosesRequest Start(const PoseRate& rate) {
  v1::StreamPosesRequest request;
  request.mutable_start()->set_rate_hz(rate.rate_hz);
  request.mutable_start()->set_batch(static_cast<std::uint32_t>(BatchOf(rate)));
  request.mutable_start()->set_max_unacknowledged(kFollowWindow);
  return request;
}

}  // namespace

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

namespace {

using namespace std::chrono_literals;

constexpr auto kVolumePoll = 50ms;  // how often to look for the end
// After errors that an immediate retry does not mend: a volume that is too large, a daemon of
// another version.
constexpr auto kPauseAfterRefusal = 5000ms;

}  // namespace

VolumeFollower::VolumeFollower(Link& link, Monitor& monitor, std::function<void()> on_volume)
    : link_(link), monitor_(monitor), on_volume_(std::move(on_volume)) {}

void VolumeFollower::Begin() {
  thread_ = std::thread([this] { Run(); });
}

void VolumeFollower::End() {
  if (thread_.joinable()) thread_.join();
}

VolumeStatus VolumeFollower::status() const {
  const std::lock_guard lock(mutex_);
  return status_;
}

void VolumeFollower::Run() {
  while (!monitor_.stopping()) {
    const std::uint64_t epoch = monitor_.WaitUntilConnected(1000ms);
    if (epoch == 0) continue;
    try {
      Follow(epoch);
    } catch (const Error& error) {
      mirror_.Reset();
      Say(nullptr, error.what());
      if (copy_.Merge(mirror_) && on_volume_) on_volume_();
      monitor_.Pause(kPauseAfterRefusal);
    }
  }
}

// Each connection has its own reader: an old reader would first wait out its pause. The mirror
// stays, with the revision to resume from.
void VolumeFollower::Follow(std::uint64_t epoch) {
  VolumeReader reader(link_.volume_channel(), mirror_);
  std::string problem;
  while (!monitor_.stopping() && monitor_.IsConnected(epoch)) {
    switch (reader.Next(kVolumePoll)) {
      case VolumeReader::Event::kTimeout:
        continue;
      case VolumeReader::Event::kLost:
        problem = reader.last_loss()->what();
        break;
      case VolumeReader::Event::kApplied:
      case VolumeReader::Event::kComplete:
        problem.clear();
        break;
    }
    Say(&reader, problem);
    if (copy_.Merge(mirror_) && on_volume_) on_volume_();
  }
  bytes_before_ += reader.bytes_received();
}

void VolumeFollower::Say(const VolumeReader* reader, const std::string& problem) {
  const std::lock_guard lock(mutex_);
  status_.complete = mirror_.is_complete();
  status_.bricks_left = mirror_.bricks_left();
  status_.bytes_received = bytes_before_ + (reader ? reader->bytes_received() : 0);
  status_.problem = problem;
  status_.is_loading = !problem.empty() && reader && reader->is_loading();
}

}  // namespace palpate::client
