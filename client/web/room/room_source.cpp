#include "client/web/room/room_source.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <utility>

#include "client/sdk/device.h"
#include "client/web/upstream/source.h"
#include "client/web/upstream/topic_text.h"
#include "client/web/volume/blob.h"
#include "client/web/volume/manifest.h"
#include "client/web/wire/envelope.h"
#include "common/error/text.h"

namespace palpate::web {
namespace {

using std::chrono::steady_clock;

constexpr std::size_t kMostAsked = 64;  // at a time
constexpr std::chrono::seconds kSteerPatience{3};
// What palpated does. While the room is not live, nobody knows whether it still does.
constexpr std::array kDoing = {Topic::kSeries, Topic::kRecording};

}  // namespace

RoomSource::RoomSource(RoomOptions options, Hub& hub, Post post)
    : Source({options.version, options.log, options.steered}),
      options_(std::move(options)),
      hub_(hub),
      post_(std::move(post)),
      subjects_(options_.room),
      state_(ThisMachine(), steady_clock::now()),
      copy_(options_.room) {
  connection_since_ms_ = NowMs();
  hub_.Put(Topic::kVolume, NoFactEnvelope(GuestFact::kVolume));
  hub_.Put(Topic::kSteering, SteeringText({}));
  Listen();
  PutConnection();
  live_->Start();
  kept_->Start();
  const auto failed = [this](const std::string& why) {
    post_([this, why] { Log("NATS: " + why); });
  };
  asker_ = std::make_unique<Worker>(failed);
  steerer_ = std::make_unique<Worker>(failed);
  stopper_ = std::make_unique<Stopper>(
      post_,
      [this](const std::string& user) {
        return AskPublisher({.user = user, .key = std::string(client::kStopKey)});
      },
      failed);
}

// Poses and voxels on connections of their own: voxels would hold up the poses.
void RoomSource::Listen() {
  const auto log = [this](const std::string& line) {
    post_([this, line] { Log("NATS: " + line); });
  };
  const auto look = [this] { Note([](News&) {}); };
  const std::string name = "palpate-web --from, room " + options_.room;
  live_ = std::make_unique<NatsLink>(
      options_.server, name + ", poses",
      NatsLink::Events{.connected = look,
                       .lost = [=](const std::string& why) { look(), log(why); },
                       .refused = log});
  live_->Subscribe(subjects_.pose(), [this](const NatsMessage& message) {
    if (message.bytes.size() > kMostPoseBytes) return;
    Note([&](News& news) { news.pose = message.bytes; });
  });
  live_->Subscribe(subjects_.beat(), [this](const NatsMessage& message) {
    if (const auto beat = ParseBeat(message.bytes)) HearBeat(*beat);
  });
  kept_ = std::make_unique<NatsLink>(
      options_.server, name + ", volume",
      NatsLink::Events{.connected = [=, this] { look(), AskAnew(true); },
                       .lost = [=](const std::string& why) { look(), log(why); },
                       .missed = [this] { AskAnew(true); },
                       .refused = log});
  kept_->Subscribe(subjects_.kept_all(), [this](const NatsMessage& message) {
    TakeKept(&RoomCopy::TakeLive, message.subject, message.bytes);
  });
  // The subject of an answer ends with that of the question: an answer of a stream that keeps
  // nothing there does not name it.
  inbox_ = kept_->NewInbox() + ".";
  kept_->Subscribe(inbox_ + ">", [this](const NatsMessage& message) {
    const bool is_kept = message.status == 0;
    if (is_kept) is_answered_ = true;
    TakeKept(&RoomCopy::TakeAnswer, message.subject.substr(inbox_.size()),
             is_kept ? message.bytes : std::string_view());
  });
}

void RoomSource::Log(const std::string& line) {
  if (line != std::exchange(last_line_, line)) options_.log(line);
}

// The thread of the beats. A link between two servers may have lost a message while this gateway's
// own links stayed.
void RoomSource::HearBeat(const Beat& beat) {
  Note([&](News& news) { news.beat = beat; });
  {
    const std::lock_guard lock(copy_mutex_);
    if (!copy_.TakeBeat(beat.kept, steady_clock::now())) return;
  }
  Ask();
}

// Threads of links. What is new is noted in the copy's order.
void RoomSource::TakeKept(TakeIntoCopy take, std::string_view subject, std::string_view bytes) {
  {
    const std::lock_guard lock(copy_mutex_);
    RoomCopy::News copy = (copy_.*take)(subject, bytes, steady_clock::now());
    is_complete_ = copy_.is_complete();
    Note([&](News& news) {
      news.missing_groups = copy_.missing_groups();
      if (copy.shown) news.shown = std::move(copy.shown);
      for (auto& [topic, text] : copy.texts) {
        news.texts.at(static_cast<std::size_t>(topic)) = std::move(text);
      }
    });
  }
  Ask();
}

// Threads of links, and the asker's.
void RoomSource::AskAnew(bool everything) {
  {
    const std::lock_guard lock(copy_mutex_);
    copy_.AskAnew(everything);
  }
  Ask();
}

void RoomSource::Ask() {
  std::vector<std::string> asked;
  {
    const std::lock_guard lock(copy_mutex_);
    asked = copy_.Asks(kMostAsked);
  }
  for (const std::string& subject : asked) {
    // What cannot be asked for now is asked for at the next connection.
    if (!kept_->Publish(subjects_.direct_get(subject), "", inbox_ + subject)) return;
  }
}

// A network thread that is late gets the newest of everything once.
void RoomSource::Note(const std::function<void(News&)>& note) {
  {
    const std::lock_guard lock(news_mutex_);
    note(news_);
    if (std::exchange(is_take_posted_, true)) return;
  }
  post_([this] { Take(); });
}

void RoomSource::Take() {
  News news;
  {
    const std::lock_guard lock(news_mutex_);
    news = std::exchange(news_, {});
    is_take_posted_ = false;
  }
  const auto now = steady_clock::now();
  state_.TakeLink(live_->is_connected(), now);
  if (news.beat) state_.TakeBeat(*news.beat, now);
  for (std::size_t topic = 0; topic < news.texts.size(); ++topic) {
    std::optional<std::string>& text = news.texts[topic];
    if (!text) continue;
    if (static_cast<Topic>(topic) == Topic::kConnection) {
      state_.TakeText(*text);
    } else if (static_cast<Topic>(topic) == Topic::kCopy) {
      state_.TakeCopyText(*text);
    } else if (std::ranges::count(kDoing, static_cast<Topic>(topic)) > 0) {
      doing_[topic] = *std::move(text);
    } else {
      hub_.Put(static_cast<Topic>(topic), *std::move(text));
    }
  }
  if (news.shown) PutShown(*std::move(news.shown));
  if (news.missing_groups) missing_groups_ = *news.missing_groups;
  PutCopy();
  PutConnection();
  if (news.pose && state_.is_published(now)) PutPose(*std::move(news.pose));
}

void RoomSource::PutShown(RoomCopy::Shown shown) {
  state_.TakeVolume();
  hub_.Put(Topic::kVolume, std::move(shown.volume));
  if (!shown.placement.empty()) hub_.Put(Topic::kPlacement, std::move(shown.placement));
  hub_.Put(Topic::kManifest, std::move(shown.manifest));
}

// Poses and voxels come by connections of their own, so the loss of one says nothing of the other.
void RoomSource::PutCopy() {
  constexpr std::uint64_t kBricks = std::uint64_t{kGroupBricks} * kGroupBricks * kGroupBricks;
  state_.TakeVolumeLink(kept_->is_connected());
  const RoomState::Volume volume = state_.volume();
  hub_.Put(Topic::kCopy, CopyText(kBricks * missing_groups_, volume.problem, volume.is_loading));
}

void RoomSource::PutPose(std::string sent) {
  const std::int64_t now_ns = MonotonicNs();
  const bool is_fresh = state_.is_published(steady_clock::now());
  auto pose = ForwardedPose(sent, {now_ns, state_.shares_clock(), is_fresh});
  if (!pose) return;
  pose_ = std::move(sent);
  if (is_fresh) SetPoseTime(now_ns - static_cast<std::int64_t>(1e6 * pose->age_ms.value_or(0.0)));
  hub_.PutPose(std::move(pose->bytes));
}

void RoomSource::PutConnection() {
  const RoomState::Connection before = std::exchange(connection_, state_.At(steady_clock::now()));
  const bool is_connected = connection_.state == client::ConnectionState::kConnected;
  if (connection_.state != before.state) connection_since_ms_ = NowMs();
  hub_.Put(Topic::kConnection, ConnectionText(connection_.state, connection_.why,
                                              connection_.palpated, connection_since_ms_));
  const std::string missing = state_.MissingVolume();
  const std::string now = !is_connected     ? connection_.why
                          : missing.empty() ? "live"
                                            : "no volume: " + missing;
  if (now != std::exchange(logged_state_, now)) {
    options_.log("room " + options_.room + ": " + OneLine(now));
  }
  const bool is_told = is_connected && kept_->is_connected();
  for (const Topic topic : kDoing) {
    const std::string& told = doing_[static_cast<std::size_t>(topic)];
    hub_.Put(topic, is_told && !told.empty() ? told : NoFactEnvelope(*FactOf(topic)));
  }
  // The last pose again, as an old one.
  if (before.state == client::ConnectionState::kConnected && !is_connected) PutPose(pose_);
}

void RoomSource::Poll() {
  Take();
  asker_->Put("second", [this](bool is_replaced) {
    if (is_replaced) return;
    {
      const std::lock_guard lock(copy_mutex_);
      copy_.Expire(steady_clock::now());
    }
    // The server had nothing, something older, or no time.
    if (!is_complete_ && !is_answered_.exchange(false)) AskAnew(false);
  });
}

void RoomSource::Steer(const SteerRequest& request, std::function<void(std::string error)> done) {
  std::string refusal;
  const bool is_stop = request.key == client::kStopKey;
  if (!is_stop && !UpdateOf(request.key, request.value) && !FacingOf(request.key, request.value)) {
    refusal = request.key + " does not take this value";
  } else if (options_.server.user.empty()) {
    refusal = "this gateway may not change settings";
  } else if (!is_stop) {
    refusal = connection_.why;
  }
  if (!refusal.empty()) {
    options_.steered(false);
    return done(refusal);
  }
  if (is_stop) {
    return stopper_->Ask(request.user,
                         [this, request, done = std::move(done)](const std::string& error) {
                           TellSteered(request, error);
                           done(error);
                         });
  }
  steerer_->PutLast(request.user + " " + request.key,
                    [this, request, done = std::move(done)](bool is_replaced) {
                      if (is_replaced) return done("");
                      post_([this, request, done, error = AskPublisher(request)] {
                        TellSteered(request, error);
                        done(error);
                      });
                    });
}

// The steerer's thread.
std::string RoomSource::AskPublisher(const SteerRequest& request) {
  constexpr const char* kSilent = "the room's publisher does not answer";
  using nlohmann::json;
  const json question{{"user", request.user}, {"key", request.key}, {"value", request.value}};
  const auto answer =
      live_->Request(subjects_.steer(options_.server.user),
                     question.dump(-1, ' ', false, json::error_handler_t::replace), kSteerPatience);
  const json parsed = json::parse(answer.value_or(""), nullptr, false);
  if (!parsed.is_object() || !parsed.contains("error") || !parsed["error"].is_string()) {
    return kSilent;
  }
  return OneLine(parsed["error"].get<std::string>());
}

}  // namespace palpate::web
