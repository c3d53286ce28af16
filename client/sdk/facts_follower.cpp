#include "client/sdk/facts_follower.h"

#include <utility>
#include <vector>

#include "client/sdk/acknowledged_call.h"
#include "client/sdk/setting_messages.h"

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

}  // namespace palpate::client
