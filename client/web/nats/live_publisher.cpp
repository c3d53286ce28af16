#include "client/web/nats/live_publisher.h"

#include "client/web/access/secret.h"
#include "client/web/nats/remote_steering.h"

namespace palpate::web {
namespace {

// nats-server lets a user name any subject for the answer, such as one of another room: it must be
// the user's own. "_R_." is what nats-server makes of the inbox of a user with another account.
bool IsInboxOf(const std::string& user, std::string_view subject) {
  return subject.starts_with(InboxPrefix(user) + ".") || subject.starts_with("_R_.");
}

}  // namespace

LivePublisher::LivePublisher(const NatsServer& server, const Subjects& subjects, Calls calls)
    : subjects_(subjects),
      calls_(std::move(calls)),
      beat_({.session = NewSecret(64), .machine = ThisMachine()}),
      link_(server, "palpate-web: poses of room " + subjects.room(),
            {.connected = [this] { SetWhy(""); },
             .lost = [this](const std::string& why) { SetWhy("NATS is not reached: " + why); },
             .missed = {},
             .refused = [this](const std::string& why) { SetWhy("NATS refuses: " + why); }}) {
  link_.Subscribe(subjects_.beat(), [this](const NatsMessage& message) { TakeBeat(message); });
  link_.Subscribe(subjects_.steer_all(),
                  [this](const NatsMessage& message) { TakeRequest(message); });
  link_.Start();
  thread_ = std::thread([this] { Run(); });
}

LivePublisher::~LivePublisher() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake_.notify_all();
  thread_.join();
  link_.End();
}

void LivePublisher::PutPose(std::shared_ptr<const std::string> pose) {
  {
    const std::lock_guard lock(mutex_);
    pose_ = std::move(pose);
  }
  wake_.notify_all();
}

void LivePublisher::SetKept(std::map<std::string, std::string> kept) {
  const std::lock_guard lock(mutex_);
  beat_.kept = std::move(kept);
}

void LivePublisher::Reply(std::string subject, std::string json) {
  {
    const std::lock_guard lock(mutex_);
    replies_.emplace_back(std::move(subject), std::move(json));
    --requests_;
  }
  wake_.notify_all();
}

std::string LivePublisher::problem() const {
  const std::lock_guard lock(mutex_);
  if (!why_.empty()) return why_;
  return other_ == Other::kPublishes ? "another gateway publishes this room" : "";
}

void LivePublisher::SetWhy(const std::string& why) {
  {
    const std::lock_guard lock(mutex_);
    why_ = why;
  }
  calls_.problem_changed();
}

void LivePublisher::Run() {
  Time next_beat{};
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait_until(lock, next_beat, [this] { return stopping_ || pose_ || !replies_.empty(); });
    if (stopping_) return;
    const Time now = std::chrono::steady_clock::now();
    const Other other = Look(now);
    const bool is_other = std::exchange(other_, other) != other;
    const auto pose = std::exchange(pose_, nullptr);
    const auto replies = std::exchange(replies_, {});
    const Beat beat = beat_;
    lock.unlock();
    if (is_other) {
      calls_.other_changed(other);
      calls_.problem_changed();
    }
    for (const auto& [subject, json] : replies) link_.Publish(subject, json);
    const bool sends = other != Other::kPublishes;
    if (pose && sends) link_.Publish(subjects_.pose(), *pose);
    if (now >= next_beat) {
      if (sends) link_.Publish(subjects_.beat(), ToJson(beat));
      next_beat = now + kBetweenBeats;
    }
    lock.lock();
  }
}

// The caller holds the lock.
LivePublisher::Other LivePublisher::Look(Time now) {
  if (other_beat_ == Time() || now - other_beat_ > kBeatLife) return Other::kNone;
  return other_session_ < beat_.session ? Other::kPublishes : Other::kWaits;
}

void LivePublisher::TakeBeat(const NatsMessage& message) {
  const auto beat = ParseBeat(message.bytes);
  if (!beat || beat->session == beat_.session) return;
  const std::lock_guard lock(mutex_);
  other_session_ = beat->session;
  other_beat_ = std::chrono::steady_clock::now();
}

void LivePublisher::TakeRequest(const NatsMessage& message) {
  const auto user = subjects_.ParseSteer(message.subject);
  if (!user || !IsInboxOf(*user, message.reply)) return;
  constexpr std::size_t kMostBytes = 1024;
  bool is_taken = message.bytes.size() <= kMostBytes;
  {
    const std::lock_guard lock(mutex_);
    is_taken = is_taken && other_ != Other::kPublishes && requests_ < kMostRequests;
    if (is_taken) ++requests_;
  }
  if (is_taken) {
    calls_.steer(*user, std::string(message.bytes), std::string(message.reply));
  } else {
    link_.Publish(std::string(message.reply), SteerAnswer("too many requests, or too long"));
  }
}

}  // namespace palpate::web
