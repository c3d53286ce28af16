#include "client/web/room/room_publisher.h"

#include <chrono>
#include <utility>
#include <variant>

namespace palpate::web {
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
  if (topic == Topic::kGuests || topic == Topic::kCopy) return;
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
