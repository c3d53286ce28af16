#include "client/view/palpated/live_feed.h"

#include <algorithm>
#include <deque>
#include <mutex>
#include <utility>

namespace palpate::view {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kPoseRate_hz = 60.0;

// Keeps all poses that came, because frames may be slower than poses.
class PoseInbox {
 public:
  // Called on the pose thread. If no frame takes the poses, as while the window is iconified, they
  // are kept only as long as the plots show them.
  void Put(const client::PoseBatch& batch) {
    const auto received_ns = std::chrono::nanoseconds(batch.received.time_since_epoch()).count();
    const std::lock_guard lock(mutex_);
    for (const client::Pose& pose : batch.poses) {
      arrived_.push_back({pose, 1e-6 * static_cast<double>(received_ns - pose.time_ns)});
      if (arrived_.size() > PlotHistory::kMost) arrived_.pop_front();
    }
  }
  struct Arrived {
    client::Pose pose;
    double age_ms = 0.0;  // when it came, if the clock is shared
  };
  std::deque<Arrived> Take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(arrived_, {});
  }

 private:
  std::mutex mutex_;
  std::deque<Arrived> arrived_;
};

// Waiting changes of the series.
class SeriesControls {
 public:
  // Returns true if nothing waited: the caller then requests a command.
  bool Put(const client::SeriesControl& newer) {
    const std::lock_guard lock(mutex_);
    const bool is_first = !waiting_;
    if (is_first) waiting_.emplace();
    const auto merge = [](const auto& from, auto& to) {
      if (from) to = from;
    };
    merge(newer.playing, waiting_->playing);
    merge(newer.position_frames, waiting_->position_frames);
    merge(newer.rate_hz, waiting_->rate_hz);
    merge(newer.loop, waiting_->loop);
    merge(newer.interpolate, waiting_->interpolate);
    return is_first;
  }
  client::SeriesControl Take() {
    const std::lock_guard lock(mutex_);
    return *std::exchange(waiting_, std::nullopt);
  }

 private:
  std::mutex mutex_;
  std::optional<client::SeriesControl> waiting_;
};

client::ClientOptions Follow(const client::ServerChoice& server, PoseInbox& inbox,
                             std::atomic<std::uint64_t>& losses) {
  return {
      .profile = server.profile,
      .address = server.address,
      .credentials = server.credentials,
      .poses = {.rate_hz = kPoseRate_hz},
      .follow_volume = true,
      .callbacks = {.on_connection =
                        [&losses](const client::Connection& connection) {
                          if (connection.state == client::ConnectionState::kLost) ++losses;
                        },
                    .on_poses = [&inbox](const client::PoseBatch& batch) { inbox.Put(batch); }}};
}

// As if `newer` had come together with the updates before it.
void Merge(client::VolumeUpdate&& newer, std::optional<client::VolumeUpdate>& waiting) {
  if (!waiting || newer.all) {
    waiting = std::move(newer);
    return;
  }
  newer.all = waiting->all;
  newer.changed.insert(newer.changed.end(), waiting->changed.begin(), waiting->changed.end());
  Join(newer.changed);
  waiting = std::move(newer);
}

}  // namespace

// One connection and everything that uses it.
struct LiveFeed::Line {
  Line(const client::ServerChoice& server, std::atomic<std::uint64_t>& losses)
      : client(Follow(server, inbox, losses)) {
    // The top bar says so; meanwhile other questions are answered.
    client.SetOnLoading([](const std::string&) { return false; });
  }
  // Ends the calls, so that the threads below can be joined at once.
  ~Line() { client.EndCalls(); }

  PoseInbox inbox;
  client::Client client;
  SeriesControls series_controls;
  Commands commands{client};
  Task<client::EditResult> filter{client};
  VolumeLoader loader{client};
  Replayer replayer{client, commands};
  EmergencyStop emergency_stop{client};
  std::unique_ptr<client::HandLead> hand;
};

LiveFeed::LiveFeed(const client::ServerChoice& server)
    : line_(std::make_unique<Line>(server, losses_)) {}

LiveFeed::~LiveFeed() = default;

void LiveFeed::Connect(const client::ServerChoice& server) {
  line_ = std::make_unique<Line>(server, losses_);
  is_disconnected_ = false;
  // Strokes, poses and voxels of the previous connection are void.
  ++losses_;
  client::VolumeUpdate nothing;
  nothing.all = true;
  volume_.Take(nothing);
  waiting_.reset();
  pose_.reset();
  settings_.reset();
  plots_ = {};
  facts_ = std::make_shared<const client::Facts>();
  shared_ = {};
  was_connected_ = false;
}

void LiveFeed::Disconnect() {
  line_->client.Disconnect();
  is_disconnected_ = true;
}

void LiveFeed::Poll() {
  // First: a large volume takes seconds, after which the pose must be fresh.
  if (auto update = line_->client.TakeVolumeUpdate()) Merge(*std::move(update), waiting_);
  if (waiting_ && (!awaits_whole_ || waiting_->complete || !waiting_->lattice)) {
    volume_.Take(*std::exchange(waiting_, std::nullopt));
  }
  for (const PoseInbox::Arrived& arrived : line_->inbox.Take()) {
    pose_ = arrived.pose;
    pose_came_ = Clock::now();
    plots_.Add(arrived.pose, is_here() ? arrived.age_ms : -1.0);
  }
  plots_.EndAt(plots_end_ns());
  const client::ConnectionState state = line_->client.connection().state;
  const bool connected = state == client::ConnectionState::kConnected;
  if (connected && !was_connected_) connected_at_ = Clock::now();
  was_connected_ = connected;
  line_->emergency_stop.Follow(state);
  settings_ = line_->client.NewestSettings();
  // A load takes long: what counts is when it ends.
  if (line_->loader.opens()) shared_.NoteOwn("volume");
  auto facts = connected ? line_->client.NewestFacts() : std::make_shared<const client::Facts>();
  if (std::swap(facts, facts_); facts != facts_) {
    shared_.Take(facts_->activity, facts_->activity_came);
  }
  polled_at_ = Clock::now();
}

const client::Hand* LiveFeed::device() const {
  return facts_->hands && !facts_->hands->hands.empty() ? &facts_->hands->hands.front() : nullptr;
}
bool LiveFeed::is_stopping() const { return line_->emergency_stop.is_running(); }
client::Connection LiveFeed::connection() const { return line_->client.connection(); }
std::string LiveFeed::name() const { return line_->client.name(); }
bool LiveFeed::is_here() const { return line_->client.shares_clock(); }
client::VolumeStatus LiveFeed::volume_status() const { return line_->client.volume_status(); }
std::uint64_t LiveFeed::dropped_poses() const { return line_->client.dropped_poses(); }

std::optional<double> LiveFeed::stream_age_ms() const {
  if (!pose_ || !is_here()) return std::nullopt;
  const std::chrono::nanoseconds now = Clock::now().time_since_epoch();
  return 1e-6 * static_cast<double>(now.count() - pose_->time_ns);
}

std::optional<double> LiveFeed::silent_s() const {
  if (!was_connected_) return std::nullopt;
  // Measured at the last Poll: a slow frame is not a silence of palpated.
  const auto silent = polled_at_ - std::max(pose_came_, connected_at_);
  if (silent < kSilence) return std::nullopt;
  return std::chrono::duration<double>(silent).count();
}

std::int64_t LiveFeed::plots_end_ns() const {
  if (!pose_) return 0;
  return pose_->time_ns + std::chrono::nanoseconds(Clock::now() - pose_came_).count();
}

bool LiveFeed::is_replay() const {
  const bool comes = connection().state == client::ConnectionState::kConnected && !silent_s();
  return comes && pose_ && pose_->replayed;
}

const Commands& LiveFeed::commands() const { return line_->commands; }
Commands& LiveFeed::commands() { return line_->commands; }

void LiveFeed::ControlSeries(const client::SeriesControl& control) {
  SeriesControls& controls = line_->series_controls;
  shared().NoteOwn("series");
  if (!controls.Put(control)) return;
  commands().Do("series",
                [&controls](client::Client& client) { client.ControlSeries(controls.Take()); });
}

void LiveFeed::EnableForces(const std::string& kind) {
  shared().NoteOwn("forces");
  commands().Do("enable forces", [kind](client::Client& client) { client.EnableForces(kind); });
}
void LiveFeed::DisableForces() {
  shared().NoteOwn("forces");
  commands().Do("disable forces", [](client::Client& client) { client.DisableForces(); });
}
void LiveFeed::StopForces() {
  shared().NoteOwn("forces");
  line_->emergency_stop.Send();
}

void LiveFeed::StartRecording(const std::string& path) {
  shared().NoteOwn("recording");
  commands().Do("record", [path](client::Client& client) { client.StartRecording(path); });
}
void LiveFeed::StopRecording() {
  shared().NoteOwn("recording");
  commands().Do("stop recording", [](client::Client& client) { client.StopRecording(); });
}

void LiveFeed::TakeHand() {
  shared().NoteOwn("hand");
  GiveHandBack();
  line_->hand = line_->client.LeadHand();
}
void LiveFeed::GiveHandBack() { line_->hand.reset(); }
client::HandLead* LiveFeed::hand() { return line_->hand.get(); }

Task<client::EditResult>& LiveFeed::filter() { return line_->filter; }
VolumeLoader& LiveFeed::loader() { return line_->loader; }
const VolumeLoader& LiveFeed::loader() const { return line_->loader; }
Replayer& LiveFeed::replayer() { return line_->replayer; }
const Replayer& LiveFeed::replayer() const { return line_->replayer; }
const EmergencyStop& LiveFeed::emergency_stop() const { return line_->emergency_stop; }

}  // namespace palpate::view
