#include "server/volume_stream/volume_streams.h"

#include <pthread.h>
#include <sys/resource.h>
#include <sys/types.h>
#include <unistd.h>

#include <algorithm>
#include <optional>
#include <random>
#include <set>
#include <utility>

#include "common/error/error.h"

namespace palpate {
namespace {

constexpr int kNice = 10;
// How often the streams check held volumes while nothing else happens.
constexpr std::chrono::milliseconds kLetGoPeriod{250};

std::uint64_t RandomId() {
  std::random_device random;
  std::uint64_t id = 0;
  while (id == 0) id = std::uint64_t{random()} << 32 | random();
  return id;
}

}  // namespace

class VolumeStreams::Stream {
 public:
  Stream(VolumeFeed made, std::weak_ptr<VolumeSink> to)
      : feed(std::move(made)), sink(std::move(to)) {}

  std::optional<VolumeFeed> feed;  // used by the streams' thread; none after the end
  const std::weak_ptr<VolumeSink> sink;
  // The streams' mutex guards the members below.
  std::uint64_t acknowledged = 0;
  bool writing = false;
  bool ended = false;
  std::uint64_t held_revision = 0;  // that the feed holds, for old_volumes_held; 0: none
};

VolumeStreams::VolumeStreams(Session& session, std::function<VolumeFeed::Clock::time_point()> now)
    : daemon_id_(RandomId()),
      clock_(std::move(now)),
      first_load_(session.first_load()),
      listening_(session, *this) {}

std::shared_ptr<VolumeStreams::Stream> VolumeStreams::Subscribe(const VolumeFeedOptions& options,
                                                                std::weak_ptr<VolumeSink> sink) {
  first_load_.Require();
  const std::lock_guard lock(mutex_);
  if (stopped_) throw Error(ErrorKind::kUnavailable, "palpated is ending");
  auto stream =
      std::make_shared<Stream>(VolumeFeed(options, daemon_id_, now(), clock_()), std::move(sink));
  if (!thread_.joinable()) thread_ = std::thread([this] { Run(); });
  streams_.push_back(stream);
  Wake();
  return stream;
}

void VolumeStreams::Acknowledge(Stream& stream, std::uint64_t message_number) {
  const std::lock_guard lock(mutex_);
  stream.acknowledged = std::max(stream.acknowledged, message_number);
  Wake();
}

void VolumeStreams::WriteDone(Stream& stream) {
  const std::lock_guard lock(mutex_);
  stream.writing = false;
  Wake();
}

void VolumeStreams::Unsubscribe(Stream& stream) {
  const std::lock_guard lock(mutex_);
  stream.ended = true;
  Wake();
}

void VolumeStreams::OnScene(const Scene& scene, std::span<const BrickChange>) {
  // Freed after the lock is released, if this is the last holder.
  VolumeNow now{scene.volume, scene.X_DI(), scene.settings_revision, scene.patient_axes};
  const std::lock_guard lock(mutex_);
  const bool has_lattice =
      live_.volume && live_.volume->loaded_revision() == scene.volume->loaded_revision();
  now.background_hash = has_lattice ? live_.background_hash : BackgroundHashOf(*scene.volume);
  std::swap(live_, now);
  if (!streams_.empty()) Wake();
}

void VolumeStreams::Show(const ShownScene* replayed) {
  std::optional<VolumeNow> now;  // freed after the lock, as above
  const std::lock_guard lock(mutex_);
  if (replayed) {
    // The same lattice: a replay shows the volume that is loaded.
    now = {replayed->volume,   replayed->X_DI, replayed->settings_revision,
           live_.patient_axes, true,           live_.background_hash};
  }
  replayed_.swap(now);
  if (!streams_.empty()) Wake();
}

void VolumeStreams::Wake() {
  woken_ = true;
  wake_.notify_one();
}

void VolumeStreams::Stop() noexcept {
  std::vector<std::shared_ptr<Stream>> streams;
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
    streams = streams_;
    Wake();
  }
  for (const auto& stream : streams) {
    if (const auto sink = stream->sink.lock()) sink->End();
  }
  if (thread_.joinable()) thread_.join();
  const std::lock_guard lock(mutex_);
  streams_.clear();
}

// The data of one subscriber's turn, read under the lock.
struct VolumeStreams::Turn {
  std::shared_ptr<Stream> stream;
  std::uint64_t acknowledged = 0;
  bool writing = false;
};

// Destroyed without the lock: it may be the last holder of a volume.
struct VolumeStreams::Round {
  VolumeNow now;
  std::vector<Turn> turns;
  std::vector<std::shared_ptr<Stream>> ended;
};

void VolumeStreams::Run() {
  pthread_setname_np(pthread_self(), "palpate-volume");
  // Sets the priority of this thread only. If that is refused, the thread keeps its priority.
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kNice);
  bool worked = true;
  while (const std::optional<Round> round = NextRound(worked)) {
    worked = false;
    for (const Turn& turn : round->turns) {
      try {
        worked |= Take(turn, round->now);
      } catch (const std::exception&) {
        // Out of memory: this stream ends, the other streams continue.
        if (const auto sink = turn.stream->sink.lock()) sink->End();
        Unsubscribe(*turn.stream);
      }
    }
    // A holder of the stream must not keep the feed's volume.
    for (const auto& stream : round->ended) stream->feed.reset();
  }
}

std::optional<VolumeStreams::Round> VolumeStreams::NextRound(bool at_once) {
  std::unique_lock lock(mutex_);
  const auto is_woken = [this] { return woken_; };
  const bool holds_any = std::any_of(streams_.begin(), streams_.end(),
                                     [](const auto& s) { return s->held_revision != 0; });
  if (!at_once && holds_any) {
    wake_.wait_for(lock, kLetGoPeriod, is_woken);
  } else if (!at_once) {
    wake_.wait(lock, is_woken);
  }
  woken_ = false;
  if (stopped_) return std::nullopt;
  Round round{now(), {}, {}};
  for (const auto& stream : streams_) {
    if (stream->ended) {
      round.ended.push_back(stream);
    } else {
      round.turns.push_back({stream, stream->acknowledged, stream->writing});
    }
  }
  std::erase_if(streams_, [](const auto& stream) { return stream->ended; });
  return round;
}

bool VolumeStreams::Take(const Turn& turn, const VolumeNow& now) {
  Stream& stream = *turn.stream;
  const auto time = clock_();
  stream.feed->Acknowledge(turn.acknowledged, time);
  const bool works = !turn.writing && stream.feed->HasWork(now);
  std::optional<VolumeMessage> message;
  if (works) {
    message = stream.feed->Step(now, time);
  } else {
    stream.feed->LetGo(now, time);
  }
  {
    const std::lock_guard lock(mutex_);
    stream.held_revision = stream.feed->held() ? stream.feed->held()->revision() : 0;
    // Set before the write, because WriteDone may come at once.
    stream.writing |= message.has_value();
  }
  if (!message) return works;
  const std::shared_ptr<VolumeSink> sink = stream.sink.lock();
  if (!sink || !sink->Write(*std::move(message))) Unsubscribe(stream);
  return true;
}

std::size_t VolumeStreams::old_volumes_held() const {
  const std::lock_guard lock(mutex_);
  std::set<std::uint64_t> revisions;
  for (const auto& stream : streams_) {
    if (stream->held_revision != 0) revisions.insert(stream->held_revision);
  }
  if (now().volume) revisions.erase(now().volume->revision());
  return revisions.size();
}

std::size_t VolumeStreams::streams() const {
  const std::lock_guard lock(mutex_);
  return streams_.size();
}

}  // namespace palpate
