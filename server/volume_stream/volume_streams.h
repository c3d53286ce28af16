// Serves all subscribers of the volume. The transport is elsewhere (VolumeSink).
//
// One thread, "palpate-volume", builds every message. The thread runs at a lower priority (nice)
// than the others. It sleeps until the session publishes, a write is done, or an acknowledgement
// comes. Then it gives each subscriber one step in turn.
//
// Threads: any; OnScene does not block and only swaps two pointers.
// Ownership: holds sinks by weak_ptr. The session borrows this object as a listener: construct it
// after the session, before the first load.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "server/session/session.h"
#include "server/volume_stream/volume_feed.h"

namespace palpate {

// Sends the messages of one subscriber.
class VolumeSink {
 public:
  virtual ~VolumeSink() = default;
  // Sends one message. Called on the "palpate-volume" thread; the next call comes only after
  // WriteDone. Must not block. Returns false if the subscriber has left.
  virtual bool Write(VolumeMessage message) = 0;
  // Ends the stream. Called on the thread that calls Stop, or on "palpate-volume" if a message
  // cannot be built (out of memory).
  virtual void End() = 0;
};

class VolumeStreams final : public SceneListener {
 public:
  class Stream;

  // now: the clock that decides when a subscriber has stalled; tests pass their own.
  explicit VolumeStreams(Session& session, std::function<VolumeFeed::Clock::time_point()> now =
                                               VolumeFeed::Clock::now);
  ~VolumeStreams() override { Stop(); }
  VolumeStreams(const VolumeStreams&) = delete;
  VolumeStreams& operator=(const VolumeStreams&) = delete;

  // Names this run of the daemon; random, never 0.
  std::uint64_t daemon_id() const { return daemon_id_; }

  // Errors: those of VolumeFeed's constructor; kLoading before the first volume; kUnavailable after
  // Stop.
  std::shared_ptr<Stream> Subscribe(const VolumeFeedOptions& options,
                                    std::weak_ptr<VolumeSink> sink);
  void Acknowledge(Stream& stream, std::uint64_t message_number);
  void WriteDone(Stream& stream);
  // Ends the stream. A message that is being built may still be written.
  void Unsubscribe(Stream& stream);

  // Ends every stream and joins the thread. There is no restart.
  void Stop() noexcept;

  void OnScene(const Scene& scene, std::span<const BrickChange> changes) override;
  // Sends a replay's scene in place of the session's; null: the session's again.
  void Show(const ShownScene* replayed);

  // The number of volumes held for subscribers, without the newest one.
  std::size_t old_volumes_held() const;
  std::size_t streams() const;

 private:
  struct Turn;
  struct Round;

  const VolumeNow& now() const { return replayed_ ? *replayed_ : live_; }
  void Wake();
  void Run();
  // Waits for work, unless `at_once`. Returns none after Stop.
  std::optional<Round> NextRound(bool at_once);
  // Does one step for a subscriber. Returns true if there was work.
  bool Take(const Turn& turn, const VolumeNow& now);

  const std::uint64_t daemon_id_;
  const std::function<VolumeFeed::Clock::time_point()> clock_;
  const FirstLoad& first_load_;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable wake_;
  bool woken_ = false;
  bool stopped_ = false;
  VolumeNow live_;
  std::optional<VolumeNow> replayed_;  // in place of live_
  std::vector<std::shared_ptr<Stream>> streams_;
  std::thread thread_;

  const Listening listening_;
};

}  // namespace palpate
