#include "client/web/nats/room_publisher.h"

#include <chrono>
#include <utility>
#include <variant>

namespace palpate::web {
namespace {

constexpr std::chrono::minutes kBetweenEqualLines{1};

}  // namespace

RoomPublisher::RoomPublisher(RoomOptions options, Hub& hub, Post post)
    : options_(std::move(options)), hub_(hub), post_(std::move(post)), steering_(options_.sites) {
  const Subjects subjects(options_.room);
  kept_ = std::make_unique<KeptPublisher>(
      options_.server, subjects, hub_.find_blob,
      KeptPublisher::Calls{.problem_changed = [this] { post_([this] { LogProblem(); }); },
                           .kept =
                               [this](const std::map<std::string, std::string>& kept) {
                                 post_([this, kept] { live_->SetKept(kept); });
                               }});
  live_ = std::make_unique<LivePublisher>(options_.server, subjects, Calls());
  hub_.Subscribe(this);
  OnTopic(Topic::kVolume);
  if (hub_.pose()) OnPose();
}

RoomPublisher::~RoomPublisher() { hub_.Unsubscribe(this); }

LivePublisher::Calls RoomPublisher::Calls() {
  return {.other_changed =
              [this](LivePublisher::Other other) {
                kept_->SetWaits(other == LivePublisher::Other::kPublishes);
                post_([this, other] { TakeOther(other); });
              },
          .problem_changed = [this] { post_([this] { LogProblem(); }); },
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

void RoomPublisher::TakeOther(LivePublisher::Other other) {
  if (other == LivePublisher::Other::kWaits) {
    options_.log("another gateway tried to publish room " + options_.room);
  }
}

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

void RoomPublisher::LogProblem() {
  const std::string now = problem();
  const auto time = std::chrono::steady_clock::now();
  if (now == logged_ && (now.empty() || time - logged_at_ < kBetweenEqualLines)) return;
  logged_ = now;
  logged_at_ = time;
  options_.log("room " + options_.room +
               (now.empty() ? " is published" : " is not published: " + now));
}

}  // namespace palpate::web
