#include "client/web/room/room_publisher.h"

#include <chrono>
#include <utility>
#include <variant>

#include "client/web/logins/secret.h"
#include "client/web/room/remote_steering.h"

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
             .refused = calls_.refused}) {
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
  return waits_ && !other_session_.empty() ? "another gateway publishes this room" : "";
}

void LivePublisher::SetWhy(const std::string& why) {
  constexpr auto kListens = 2 * kBetweenBeats;
  const std::lock_guard lock(mutex_);
  why_ = why;
  listens_until_ = why.empty() ? std::chrono::steady_clock::now() + kListens : Time::max();
}

void LivePublisher::Run() {
  Time next_beat{};
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait_until(lock, next_beat, [this] { return stopping_ || pose_ || !replies_.empty(); });
    if (stopping_) return;
    const Time now = std::chrono::steady_clock::now();
    const bool waited = std::exchange(waits_, Waits(now));
    const bool waits = waits_;
    const auto pose = std::exchange(pose_, nullptr);
    const auto replies = std::exchange(replies_, {});
    lock.unlock();
    if (waits != waited) calls_.waits(waits);
    for (const auto& [subject, json] : replies) link_.Publish(subject, json);
    if (pose && !waits) link_.Publish(subjects_.pose(), *pose);
    if (now >= next_beat) {
      Beat beat = beat_;
      beat.kept = calls_.kept();
      if (!waits && link_.Publish(subjects_.beat(), ToJson(beat))) beat_at_ = now;
      next_beat = now + kBetweenBeats;
    }
    lock.lock();
  }
}

// The caller holds the lock.
bool LivePublisher::Waits(Time now) const {
  // Others take over a room that was silent for so long.
  if (now < listens_until_) return waits_ || now - beat_at_ >= kBeatLife;
  return now - other_beat_ < kBeatLife && (waits_ || other_session_ < beat_.session);
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
  std::string refusal;
  {
    const std::lock_guard lock(mutex_);
    if (waits_) return;  // the other one answers
    if (message.bytes.size() > kMostBytes) refusal = "the request is too long";
    // A few more for stops, which the sources answer at once.
    const bool is_stop = message.bytes.find("\"stop\"") != std::string_view::npos;
    if (requests_ >= kMostRequests * (is_stop ? 2 : 1)) refusal = "too many requests";
    if (refusal.empty()) ++requests_;
  }
  if (refusal.empty()) {
    calls_.steer(*user, std::string(message.bytes), std::string(message.reply));
  } else {
    link_.Publish(std::string(message.reply), SteerAnswer(refusal));
  }
}

namespace {

constexpr std::chrono::seconds kBetweenChanges{10}, kBetweenLines{60}, kFirstLine{2};

}  // namespace

RoomPublisher::RoomPublisher(RoomOptions options, Hub& hub, Post post)
    : options_(std::move(options)), hub_(hub), post_(std::move(post)), steering_(options_.sites) {
  const Subjects subjects(options_.room);
  logged_at_[0] = std::chrono::steady_clock::now() - kBetweenLines + kFirstLine;
  auto calls = Calls();
  kept_ = std::make_unique<KeptPublisher>(options_.server, subjects, hub_.find_blob, calls.refused);
  live_ = std::make_unique<LivePublisher>(options_.server, subjects, std::move(calls));
  hub_.Subscribe(this);
  OnTopic(Topic::kVolume);
  if (hub_.pose()) OnPose();
}

RoomPublisher::~RoomPublisher() { hub_.Unsubscribe(this); }

LivePublisher::Calls RoomPublisher::Calls() {
  return {.waits = [this](bool waits) { kept_->SetWaits(waits); },
          .kept = [this] { return kept_->kept(); },
          .refused =
              [this](const std::string& why) {
                const std::lock_guard lock(mutex_);
                refused_ = why;
              },
          .steer =
              [this](std::string user, std::string json, std::string reply) {
                post_([this, user = std::move(user), json = std::move(json),
                       reply = std::move(reply)] { TakeRequest(user, json, reply); });
              }};
}

bool RoomPublisher::is_connected() const { return live_->is_connected() && kept_->is_connected(); }

std::string RoomPublisher::problem() const {
  const std::string problem = live_->problem();
  return problem.empty() ? kept_->problem() : problem;
}

// Posted, so that the texts of a volume, which change one after the other, are taken together.
void RoomPublisher::OnTopic(Topic topic) {
  if (topic == Topic::kGuests) return;
  if (std::exchange(is_put_posted_, true)) return;
  post_([this] {
    is_put_posted_ = false;
    Texts texts;
    for (int n = 0; n < kTopics; ++n) {
      texts.at(static_cast<std::size_t>(n)) = hub_.Newest(static_cast<Topic>(n));
    }
    kept_->Put(std::move(texts));
  });
}

void RoomPublisher::OnPose() { live_->PutPose(hub_.pose()); }

void RoomPublisher::TakeRequest(const std::string& site, const std::string& json,
                                const std::string& reply) {
  auto judged = steering_.Judge(site, json, std::chrono::steady_clock::now());
  if (const auto* refusal = std::get_if<std::string>(&judged)) {
    if (options_.steered) options_.steered(false);
    live_->Reply(reply, SteerAnswer(*refusal));
    return;
  }
  hub_.steer(std::get<SteerRequest>(judged),
             [this, reply](const std::string& error) { live_->Reply(reply, SteerAnswer(error)); });
}

void RoomPublisher::Poll() {
  const std::string why = problem();
  const bool is_published = why.empty();
  const bool is_change = is_published != was_published_ || why != logged_;
  auto& logged_at = logged_at_.at(is_published ? 1 : 0);
  const auto now = std::chrono::steady_clock::now();
  if (now - logged_at < (is_change ? kBetweenChanges : kBetweenLines)) return;
  std::string refused;
  {
    const std::lock_guard lock(mutex_);
    refused.swap(refused_);
  }
  if (is_published && !is_change && refused.empty()) return;
  was_published_ = is_published;
  logged_ = why;
  logged_at = now;
  options_.log("room " + options_.room +
               (is_published ? " is published" : " is not published: " + why) +
               (refused.empty() ? "" : "; the NATS server refused: " + refused));
}

}  // namespace palpate::web
