#include "client/view/live/live_feed.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>

namespace palpate::view {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds kAskEvery{1};
constexpr double kPoseRate_hz = 60.0;

double AgeMs(const client::Pose& pose) {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return 1e-6 * static_cast<double>(std::chrono::nanoseconds(now).count() - pose.time_ns);
}

// Returns none if there is no answer, or the daemon is away.
template <typename Ask>
auto AnswerTo(const Ask& ask) -> std::optional<decltype(ask())> {
  try {
    return ask();
  } catch (const Error&) {
    return std::nullopt;
  }
}

// Asks in a thread of its own for what palpated does not stream.
class Questions {
 public:
  explicit Questions(client::Client& client) : client_(client), thread_([this] { Run(); }) {}
  // After Client::EndCalls, the destructor does not wait.
  ~Questions() {
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
    }
    wake_.notify_all();
    thread_.join();
  }
  Questions(const Questions&) = delete;
  Questions& operator=(const Questions&) = delete;

  struct Answers {
    std::optional<client::DaemonInfo> device{};
    std::optional<client::SeriesState> series{};
    std::optional<client::RecordingState> recording{};
    std::optional<client::VolumeInfo> volume{};
  };
  // Of the question that is asked with the others.
  struct ActivityAnswer {
    std::optional<client::Activity> activity{};
    Clock::time_point came{};
  };
  // None: there is no newer answer since the last call.
  std::optional<ActivityAnswer> TakeActivity() {
    const std::lock_guard lock(mutex_);
    return std::exchange(activity_, std::nullopt);
  }
  Answers answers() const {
    const std::lock_guard lock(mutex_);
    return answers_;
  }
  // Asks at once, after the present question.
  void Hurry() {
    {
      const std::lock_guard lock(mutex_);
      hurried_ = true;
    }
    wake_.notify_all();
  }

 private:
  void Run() {
    std::unique_lock lock(mutex_);
    while (!stopping_) {
      hurried_ = false;
      lock.unlock();
      Answers answers = {.device = AnswerTo([this] { return client_.GetDevice(); }),
                         .series = AnswerTo([this] { return client_.GetSeries(); }),
                         .recording = AnswerTo([this] { return client_.GetRecording(); }),
                         .volume = AnswerTo([this] { return client_.GetVolume(); })};
      ActivityAnswer activity{AnswerTo([this] { return client_.GetActivity(); }), Clock::now()};
      lock.lock();
      answers_ = std::move(answers);
      activity_ = std::move(activity);
      wake_.wait_for(lock, kAskEvery, [this] { return stopping_ || hurried_; });
    }
  }

  client::Client& client_;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  Answers answers_;
  std::optional<ActivityAnswer> activity_;
  bool stopping_ = false;
  bool hurried_ = false;
  std::thread thread_;
};

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

}  // namespace

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
  bool is_disconnected = false;
  Questions questions{client};
  SeriesControls series_controls;
  Commands commands{client};
  Commands filter_commands{client};
  Denoiser denoiser{filter_commands};
  Commands load_commands{client};
  VolumeLoader loader{load_commands};
  Commands replay_commands{client};
  Replayer replayer{replay_commands, commands};
  Commands urgent_commands{client};
  EmergencyStop emergency_stop{urgent_commands};
  std::unique_ptr<client::HandLead> hand;
};

struct LiveFeed::Parts {
  explicit Parts(const client::ServerChoice& server)
      : line(std::make_unique<Line>(server, losses)) {}

  std::atomic<std::uint64_t> losses{0};
  std::unique_ptr<Line> line;
  std::optional<client::Pose> pose;
  Clock::time_point pose_came{};
  Clock::time_point connected_at{};
  Clock::time_point polled_at{};
  bool was_connected = false;
  std::optional<client::Settings> settings;
  ViewVolume volume;
  bool awaits_whole = false;
  std::optional<client::VolumeUpdate> waiting;  // that the volume has not taken
  PlotHistory plots;
  std::optional<client::Activity> activity;
  SharedThings shared;
};

LiveFeed::LiveFeed(const client::ServerChoice& server) : parts_(std::make_unique<Parts>(server)) {}

void LiveFeed::Connect(const client::ServerChoice& server) {
  Parts& p = *parts_;
  auto line = std::make_unique<Line>(server, p.losses);
  p.line = std::move(line);
  // Strokes, poses and voxels of the previous connection are void.
  ++p.losses;
  client::VolumeUpdate nothing;
  nothing.all = true;
  p.volume.Take(nothing);
  p.waiting.reset();
  p.pose.reset();
  p.settings.reset();
  p.plots = {};
  p.activity.reset();
  p.shared = {};
  p.was_connected = false;
}

void LiveFeed::AwaitWhole() { parts_->awaits_whole = true; }

void LiveFeed::Disconnect() {
  parts_->line->client.Disconnect();
  parts_->line->is_disconnected = true;
}

bool LiveFeed::is_stopping() const { return parts_->line->urgent_commands.busy(); }
bool LiveFeed::is_disconnected() const { return parts_->line->is_disconnected; }

client::Role LiveFeed::role() const {
  const auto device = this->device();
  return device ? device->role : client::Role::kUnknown;
}

bool LiveFeed::May(client::Role least) const {
  const client::Role role = this->role();
  if (is_disconnected()) return false;
  return role == client::Role::kUnknown || role >= least;
}

LiveFeed::~LiveFeed() = default;

void LiveFeed::Poll() {
  Parts& p = *parts_;
  // First: a large volume takes seconds, after which the pose must be fresh.
  if (auto update = p.line->client.TakeVolumeUpdate()) Merge(*std::move(update), p.waiting);
  if (p.waiting && (!p.awaits_whole || p.waiting->complete || !p.waiting->lattice)) {
    p.volume.Take(*std::exchange(p.waiting, std::nullopt));
  }
  for (const PoseInbox::Arrived& arrived : p.line->inbox.Take()) {
    // Who replays what is known at once, too.
    if (arrived.pose.replayed != (p.pose && p.pose->replayed)) p.line->questions.Hurry();
    p.pose = arrived.pose;
    p.pose_came = Clock::now();
    p.plots.Add(arrived.pose, p.line->client.shares_clock() ? arrived.age_ms : -1.0);
  }
  p.plots.EndAt(plots_end_ns());
  const client::ConnectionState state = p.line->client.connection().state;
  const bool connected = state == client::ConnectionState::kConnected;
  if (connected && !p.was_connected) p.connected_at = Clock::now();
  p.was_connected = connected;
  p.line->emergency_stop.Follow(state);
  p.settings = p.line->client.NewestSettings();
  // A load takes long: what counts is when it ends.
  if (p.line->loader.opens()) p.shared.NoteOwn("volume");
  if (auto answer = p.line->questions.TakeActivity()) {
    p.activity = std::move(answer->activity);
    p.shared.Take(p.activity, answer->came);
  }
  p.polled_at = Clock::now();
}

client::Connection LiveFeed::connection() const { return parts_->line->client.connection(); }
std::uint64_t LiveFeed::losses() const { return parts_->losses; }
const std::string& LiveFeed::name() const { return parts_->line->client.name(); }
bool LiveFeed::is_here() const { return parts_->line->client.shares_clock(); }
const std::optional<client::Pose>& LiveFeed::pose() const { return parts_->pose; }
const std::optional<client::Settings>& LiveFeed::settings() const { return parts_->settings; }
client::VolumeStatus LiveFeed::volume_status() const {
  return parts_->line->client.volume_status();
}
const ViewVolume& LiveFeed::volume() const { return parts_->volume; }
ViewVolume& LiveFeed::volume() { return parts_->volume; }
const PlotHistory& LiveFeed::plots() const { return parts_->plots; }

std::optional<double> LiveFeed::stream_age_ms() const {
  if (!parts_->pose || !parts_->line->client.shares_clock()) return std::nullopt;
  return AgeMs(*parts_->pose);
}

std::uint64_t LiveFeed::dropped_poses() const { return parts_->line->client.dropped_poses(); }

std::optional<double> LiveFeed::silent_s() const {
  const Parts& p = *parts_;
  if (!p.was_connected) return std::nullopt;
  // Measured at the last Poll: a slow frame is not a silence of palpated.
  const auto silent = p.polled_at - std::max(p.pose_came, p.connected_at);
  if (silent < kSilence) return std::nullopt;
  return std::chrono::duration<double>(silent).count();
}

std::int64_t LiveFeed::plots_end_ns() const {
  if (!parts_->pose) return 0;
  return parts_->pose->time_ns + std::chrono::nanoseconds(Clock::now() - parts_->pose_came).count();
}

std::optional<client::DaemonInfo> LiveFeed::device() const {
  return parts_->line->questions.answers().device;
}
std::optional<client::SeriesState> LiveFeed::series() const {
  return parts_->line->questions.answers().series;
}
std::optional<client::RecordingState> LiveFeed::recording() const {
  return parts_->line->questions.answers().recording;
}

bool LiveFeed::is_replay() const {
  const bool comes =
      connection().state == client::ConnectionState::kConnected && !silent_s().has_value();
  return comes && parts_->pose && parts_->pose->replayed;
}

std::optional<client::VolumeInfo> LiveFeed::volume_info() const {
  return parts_->line->questions.answers().volume;
}

const std::optional<client::Activity>& LiveFeed::activity() const { return parts_->activity; }
const SharedThings& LiveFeed::shared() const { return parts_->shared; }
SharedThings& LiveFeed::shared() { return parts_->shared; }

const Commands& LiveFeed::commands() const { return parts_->line->commands; }
Commands& LiveFeed::commands() { return parts_->line->commands; }

void LiveFeed::DoAndAsk(std::string name, std::function<void(client::Client&)> command) {
  // The commands end before the questions do.
  parts_->line->commands.Do(
      std::move(name),
      [&questions = parts_->line->questions, command = std::move(command)](client::Client& client) {
        command(client);
        questions.Hurry();
      });
}

void LiveFeed::ControlSeries(const client::SeriesControl& control) {
  SeriesControls& controls = parts_->line->series_controls;
  shared().NoteOwn("series");
  if (!controls.Put(control)) return;
  DoAndAsk("series",
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
  parts_->line->emergency_stop.Send();
}

void LiveFeed::StartRecording(const std::string& path) {
  shared().NoteOwn("recording");
  DoAndAsk("record", [path](client::Client& client) { client.StartRecording(path); });
}
void LiveFeed::StopRecording() {
  shared().NoteOwn("recording");
  DoAndAsk("stop recording", [](client::Client& client) { client.StopRecording(); });
}

void LiveFeed::TakeHand() {
  shared().NoteOwn("hand");
  GiveHandBack();
  parts_->line->hand = parts_->line->client.LeadHand();
}
void LiveFeed::GiveHandBack() { parts_->line->hand.reset(); }
client::HandLead* LiveFeed::hand() { return parts_->line->hand.get(); }

Denoiser& LiveFeed::denoiser() { return parts_->line->denoiser; }
VolumeLoader& LiveFeed::loader() { return parts_->line->loader; }
const VolumeLoader& LiveFeed::loader() const { return parts_->line->loader; }
Replayer& LiveFeed::replayer() { return parts_->line->replayer; }
const Replayer& LiveFeed::replayer() const { return parts_->line->replayer; }
const EmergencyStop& LiveFeed::emergency_stop() const { return parts_->line->emergency_stop; }

}  // namespace palpate::view
