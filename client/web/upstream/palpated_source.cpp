#include "client/web/upstream/palpated_source.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <exception>
#include <utility>

#include "client/web/upstream/rights.h"
#include "client/web/upstream/source.h"
#include "client/web/wire/envelope.h"
#include "common/error/error.h"
#include "common/error/text.h"
#include "common/wire/address.h"

namespace palpate::web {
namespace {

using namespace std::chrono_literals;

constexpr auto kBetweenManifests = 50ms;
constexpr auto kBetweenLooks = 20ms;

}  // namespace

VolumeThread::VolumeThread(client::Client& client, bool with_groups,
                           std::function<void(const VolumeNews&)> on_news)
    : client_(client),
      on_news_(std::move(on_news)),
      volume_(with_groups),
      thread_([this] { Run(); }) {}

VolumeThread::~VolumeThread() {
  stopping_ = true;
  thread_.join();
}

void VolumeThread::Run() {
  while (!stopping_) {
    const auto began = std::chrono::steady_clock::now();
    bool is_work = true;
    try {
      is_work = Look(began);
    } catch (const std::exception& error) {
      failure_ = error.what();
    }
    // A manifest of a large volume that changes throughout takes half of the time at most.
    const auto work = std::chrono::steady_clock::now() - began;
    std::this_thread::sleep_for(is_work
                                    ? std::max<std::chrono::nanoseconds>(kBetweenManifests, work)
                                    : std::chrono::nanoseconds(kBetweenLooks));
  }
}

// Looks instead of being told: a look without news costs next to nothing, and superseded blobs are
// dropped and problems told in any case. Returns whether there is a manifest.
bool VolumeThread::Look(std::chrono::steady_clock::time_point now) {
  const auto update = client_.TakeVolumeUpdate();
  VolumeNews news;
  if (update) {
    news = NewsOf(*update);
  } else {
    volume_.Expire(now);
  }
  news.status = client_.volume_status();
  news.failure = std::exchange(failure_, {});
  const bool is_other = std::exchange(problem_, news.status.problem) != news.status.problem;
  if (is_other || update || !news.failure.empty()) on_news_(news);
  return news.manifest.has_value();
}

VolumeNews VolumeThread::NewsOf(const client::VolumeUpdate& update) {
  VolumeNews news;
  if (update.all) held_lattice_ = update.lattice;
  news.manifest = volume_.Apply(update, std::chrono::steady_clock::now());
  has_manifest_ = has_manifest_ || news.manifest;
  const bool is_held = held_lattice_ && has_manifest_ && !news.manifest;
  if (is_held || !update.lattice) return news;
  news.lattice = std::exchange(held_lattice_, std::nullopt);
  news.placement = update.placement;
  return news;
}

namespace {

constexpr std::size_t kMostSteered = 20;

// An address of this machine may lead to another one (a tunnel), whose clock is another one: then
// the age makes no sense.
bool SharesClock(const client::Client& palpated, std::int64_t age_ns) {
  constexpr std::int64_t kOldest_ns = 10'000'000'000;
  if (palpated.shares_clock()) return true;
  const HostPort address = ParseHostPort(palpated.name());
  return (address.host == "localhost" || IsLoopback(address)) && age_ns >= 0 && age_ns < kOldest_ns;
}

// Of a socket, this machine's name: guests need not know its path.
std::string PlainName(const client::Client& palpated) {
  if (!palpated.shares_clock()) return palpated.name();
  std::array<char, 256> host{};
  gethostname(host.data(), host.size() - 1);
  return host.data();
}

}  // namespace

PalpatedSource::PalpatedSource(PalpatedOptions options, Hub& hub, Post post)
    : Source({options.version, options.log, options.steered}),
      options_(std::move(options)),
      hub_(hub),
      post_(std::move(post)) {
  connection_since_ms_ = NowMs();
  hub_.Put(Topic::kVolume, NoFactEnvelope(GuestFact::kVolume));
  hub_.Put(Topic::kCopy, CopyText(0, "", false));
  hub_.Put(Topic::kSteering, SteeringText(steered_));
  client_ = std::make_unique<client::Client>(Options());
  client_->SetOnLoading([](const std::string&) { return false; });
  PutConnectionText();
  volume_ = std::make_unique<VolumeThread>(
      *client_, options_.with_groups,
      [this](const VolumeNews& news) { post_([this, news] { PutVolume(news); }); });
  const auto failed = [this](const std::string& why) {
    post_([this, why] { options_.log("a change failed: " + OneLine(why)); });
  };
  worker_ = std::make_unique<Worker>(failed);
  const auto stop = [this](const std::string&) -> std::string {
    try {
      const bool is_off = client::AreOff(client_->StopForces().forces.state);
      return is_off ? "" : "somebody has enabled the forces again";
    } catch (const Error& error) {
      post_([this, why = OneLine(error.what())] { options_.log("an emergency stop: " + why); });
      return "palpated has not confirmed it";
    }
  };
  stopper_ = std::make_unique<Stopper>(post_, stop, failed);
}

PalpatedSource::~PalpatedSource() { client_->EndCalls(); }

client::ClientOptions PalpatedSource::Options() {
  client::ClientOptions options{.profile = options_.server.profile,
                                .address = options_.server.address,
                                .credentials = options_.server.credentials,
                                .poses = {.rate_hz = 60.0, .batch = 1},
                                .follow_volume = true};
  options.callbacks.on_connection = [this](const client::Connection& connection) {
    post_([this, connection] { PutConnection(connection); });
  };
  options.callbacks.on_poses = [this](const client::PoseBatch& batch) { TakePoses(batch); };
  options.callbacks.on_facts = [this](const client::Facts& facts) {
    post_([this, facts] { PutFacts(facts); });
  };
  return options;
}

// The pose thread. A network thread that is late gets the newest pose once.
void PalpatedSource::TakePoses(const client::PoseBatch& batch) {
  {
    const std::lock_guard lock(pose_mutex_);
    pose_ = batch.poses.back();
    if (std::exchange(is_pose_posted_, true)) return;
  }
  post_([this] { PutPose(true); });
}

void PalpatedSource::PutPose(bool is_fresh) {
  client::Pose pose;
  {
    const std::lock_guard lock(pose_mutex_);
    pose = pose_;
    is_pose_posted_ = false;
  }
  const std::int64_t now_ns = MonotonicNs();
  const bool shares_clock = SharesClock(*client_, now_ns - pose.time_ns);
  if (is_fresh) SetPoseTime(shares_clock ? pose.time_ns : now_ns);
  hub_.PutPose(PoseEnvelope(pose, {now_ns, shares_clock, is_fresh}));
}

void PalpatedSource::PutConnection(const client::Connection& connection) {
  const bool is_other = connection.state != connection_.state;
  const bool is_other_why = is_other || connection.why != connection_.why;
  if (is_other) connection_since_ms_ = NowMs();
  connection_ = connection;
  PutConnectionText();
  const bool is_connected = connection.state == client::ConnectionState::kConnected;
  if (is_other && !is_connected) {
    // palpated counts anew when it starts again: another volume may have the same revision. And
    // nobody knows whether it still records.
    PutFacts({});
    // Nor does a name that comes belong to this lattice: another one comes first.
    name_ = Name::kPut;
    placement_.clear();
    manifest_.clear();
    // The last pose again, as an old one.
    if (hub_.pose()) PutPose(false);
  }
  if (is_connected) {
    options_.log("connected to palpated at " + client_->name());
  } else if (connection.state == client::ConnectionState::kLost && is_other_why) {
    options_.log("no palpated: " + OneLine(connection.why));
  }
}

void PalpatedSource::PutConnectionText() {
  hub_.Put(Topic::kConnection, ConnectionText(connection_.state, PlainWhy(connection_.state),
                                              PlainName(*client_), connection_since_ms_));
}

void PalpatedSource::PutFacts(const client::Facts& facts) {
  const auto told = [&](GuestFact fact) { return FactEnvelope(facts.message, fact); };
  if (auto settings = told(GuestFact::kSettings)) hub_.Put(Topic::kSettings, *std::move(settings));
  for (const Topic topic : {Topic::kSeries, Topic::kRecording}) {
    hub_.Put(topic, told(*FactOf(topic)).value_or(NoFactEnvelope(*FactOf(topic))));
  }
  CheckRights(facts.caller.role);
  if (facts.problem != std::exchange(facts_problem_, facts.problem) && !facts.problem.empty()) {
    options_.log("palpated does not tell what changes: " + OneLine(facts.problem));
  }
  info_ = FactEnvelope(facts.message, GuestFact::kVolume);
  info_revision_ = facts.volume ? facts.volume->loaded_revision : 0;
  PutHeld();
}

void PalpatedSource::CheckRights(client::Role role) {
  if (std::exchange(role_, role) == role) return;
  const std::string warning = RightsWarning(role, options_.steers);
  if (!warning.empty()) options_.log(warning);
}

void PalpatedSource::PutVolume(const VolumeNews& news) {
  if (news.lattice) {
    lattice_ = news.lattice;
    name_ = Name::kAwaited;
  }
  if (news.placement) placement_ = PlacementEnvelope(*news.placement);
  if (news.manifest) manifest_ = ManifestText(*news.manifest);
  PutHeld();
  hub_.Put(Topic::kCopy,
           CopyText(news.status.bricks_left, PlainProblem(news.status), news.status.is_loading));
  if (news.status.problem != problem_ && !news.status.problem.empty()) {
    options_.log("no voxels: " + OneLine(news.status.problem));
  }
  problem_ = news.status.problem;
  if (!news.failure.empty())
    options_.log("a change of the volume waits for the next one: " + news.failure);
}

// A volume's voxels wait for its name; without a name if facts are refused.
void PalpatedSource::PutHeld() {
  if (name_ != Name::kPut && info_ && info_revision_ == lattice_->loaded_revision) {
    name_ = Name::kPut;
    hub_.Put(Topic::kVolume, *info_);
  } else if (name_ == Name::kAwaited && !facts_problem_.empty()) {
    name_ = Name::kMissing;
    hub_.Put(Topic::kVolume, NoFactEnvelope(GuestFact::kVolume));
  }
  if (name_ == Name::kAwaited) return;
  if (!placement_.empty()) hub_.Put(Topic::kPlacement, std::exchange(placement_, {}));
  if (!manifest_.empty()) hub_.Put(Topic::kManifest, std::exchange(manifest_, {}));
}

void PalpatedSource::Steer(const SteerRequest& request,
                           std::function<void(std::string error)> done) {
  if (request.key == client::kStopKey) return Stop(request, std::move(done));
  const auto update = UpdateOf(request.key, request.value);
  auto facing = FacingOf(request.key, request.value);
  if (facing && lattice_) facing->loaded_revision = lattice_->loaded_revision;
  if (!update && !facing) {
    options_.steered(false);
    done(request.key + " does not take this value");
    return;
  }
  worker_->PutLast(request.user + " " + request.key,
                   [this, request, update, facing, done = std::move(done)](bool is_replaced) {
                     if (is_replaced) return done("");
                     std::string error, plain;
                     try {
                       if (update) client_->Set(*update);
                       if (facing) client_->Place({.facing = facing});
                     } catch (const Error& refusal) {
                       error = refusal.what();
                       plain = PlainRefusal(refusal);
                     } catch (const std::exception& failure) {
                       error = failure.what();
                       plain = "the gateway cannot do this now";
                     }
                     post_([this, request, done, error, plain] {
                       PutSteered(request, error);
                       done(plain);
                     });
                   });
}

void PalpatedSource::Stop(const SteerRequest& request,
                          std::function<void(std::string error)> done) {
  stopper_->Ask(request.user, [this, request, done = std::move(done)](const std::string& error) {
    PutSteered(request, error);
    done(error);
  });
}

void PalpatedSource::PutSteered(const SteerRequest& request, const std::string& error) {
  if (!TellSteered(request, error) || !error.empty()) return;
  steered_.push_back({request.user, request.key, request.value, NowMs()});
  if (steered_.size() > kMostSteered) steered_.pop_front();
  hub_.Put(Topic::kSteering, SteeringText(steered_));
}

}  // namespace palpate::web
