// Serves all subscribers of the volume, apart from the transport.
//
// One thread, "palpate-volume", niced below the others, builds every message: it
// sleeps until the session publishes, a write is done, or an acknowledgement
// comes, and then gives one step to each subscriber in turn.
//
// Threads: any; OnScene neither blocks nor takes longer than two pointers.
// Ownership: subscribers are held by weak_ptr. Borrowed by the session as a
// listener: construct it after the session, before the first load.
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
#include "server/streaming/volume_feed.h"

namespace palpate {

// Where messages go.
class VolumeSink {
 public:
  virtual ~VolumeSink() = default;
  // One message, on the thread of the streams; the next one only after WriteDone.
  // Must not block. False when there is nobody to send to any more.
  virtual bool Write(VolumeMessage message) = 0;
  // The daemon ends. On the thread that calls Stop.
  virtual void End() = 0;
};

class VolumeStreams final : public SceneListener {
 public:
  class Stream;

  // now: the clock by which subscribers stall; tests bring their own.
  explicit VolumeStreams(Session& session, std::function<VolumeFeed::Clock::time_point()> now =
                                               VolumeFeed::Clock::now);
  ~VolumeStreams() override { Stop(); }
  VolumeStreams(const VolumeStreams&) = delete;
  VolumeStreams& operator=(const VolumeStreams&) = delete;

  // Names this run of the daemon; random, never 0.
  std::uint64_t daemon_id() const { return daemon_id_; }

  // Errors: as VolumeFeed's constructor; kUnavailable before the first volume and
  // after Stop.
  std::shared_ptr<Stream> Subscribe(const VolumeFeedOptions& options,
                                    std::weak_ptr<VolumeSink> sink);
  void Acknowledge(Stream& stream, std::uint64_t message_number);
  void WriteDone(Stream& stream);
  // Nothing is written to it afterwards, but for a message that is being built.
  void Unsubscribe(Stream& stream);

  // Ends every stream and joins the thread; for good.
  void Stop() noexcept;

  void OnScene(const Scene& scene, std::span<const BrickChange> changes) override;

  // Volumes other than the newest that are held for subscribers.
  std::size_t old_volumes_held() const;
  std::size_t streams() const;

 private:
  struct Turn;
  struct Round;

  void Wake();
  void Run();
  // Waits for something to do, unless there may be some; none at the end.
  std::optional<Round> NextRound(bool at_once);
  // True when it did something.
  bool Take(const Turn& turn, const VolumeNow& now);

  const std::uint64_t daemon_id_;
  const std::function<VolumeFeed::Clock::time_point()> clock_;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable wake_;
  bool woken_ = false;
  bool stopped_ = false;
  VolumeNow now_;
  std::vector<std::shared_ptr<Stream>> streams_;
  std::thread thread_;

  const Listening listening_;
};

}  // namespace palpate
