// Keeps the newest messages of topics and the newest volume of the hub in the room's stream.
//
// The volume's message is published when all blobs that its manifest names are kept; while the hub
// has no manifest, that of before stays. Only blobs that changed are published. After a loss of the
// stream, or when somebody else wrote into it, everything is published anew, and the groups that
// are kept are dropped first. So, too, when the server refuses a message: one whose memory is full
// does not even let a message take the place of another. Then the volume waits, from 2 s up to a
// minute, or for the next manifest.
//
// Threads: a thread of its own publishes, at most 20 times a second; methods on any, which never
// wait for NATS. `refused` is called on threads of the link.
// Errors: the constructor throws kInvalidArgument as Check does.
#pragma once

#include <array>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "client/web/hub/hub.h"
#include "client/web/room/nats_link.h"
#include "client/web/room/room_protocol.h"
#include "client/web/volume/manifest.h"
#include "common/error/error.h"

namespace palpate::web {

// The stream of a room, which keeps the newest message of each kept subject in the server's memory.
//
// Threads: methods on one, which they let wait. Ownership: borrows the link.
// Errors: kDiskFull: the server refuses a message, for lack of memory; kUnavailable: all else.
// After one of them, Ensure() begins anew.
class KeptStream {
 public:
  // Before the link's Start.
  KeptStream(NatsLink& link, const Subjects& subjects);
  KeptStream(const KeptStream&) = delete;
  KeptStream& operator=(const KeptStream&) = delete;

  // Creates the stream unless it is there. Returns whether it keeps all that was acknowledged, and
  // nothing of others'. Messages count anew.
  bool Ensure();
  // Drops what is kept of the subjects.
  void Purge(const std::string& subjects);
  // Waits while kMostUnderWay messages have no answer. Bytes are copied or sent. Returns the
  // message's number, from 1.
  std::uint64_t Publish(const std::string& subject, std::string_view bytes);
  // Until all that was published is acknowledged. Calls `meanwhile`, which may publish, ten times a
  // second.
  void Wait(const std::function<void()>& meanwhile);
  // How many messages are kept: they are acknowledged in order.
  std::uint64_t acknowledged();

  static constexpr std::uint64_t kMostUnderWay = 256;

 private:
  std::string Ask(const std::string& call, const std::string& json);
  void TakeAnswer(const NatsMessage& message);
  void WaitUntilFewerThan(std::uint64_t count, const std::function<void()>& meanwhile = {});

  NatsLink& link_;
  const Subjects subjects_;
  const std::string inbox_;
  std::string created_;         // when the stream was
  std::set<std::string> kept_;  // subjects that were published since it is known

  std::mutex mutex_;
  std::condition_variable wake_;
  std::uint64_t run_ = 0;  // answers of earlier ones do not count
  std::uint64_t published_ = 0, acknowledged_ = 0;
  std::uint64_t last_sequence_ = 0;
  bool is_shared_ = false;  // others write
  std::string problem_;     // the first one
  ErrorKind kind_ = ErrorKind::kUnavailable;
};

// By topic; null: none yet.
using Texts = std::array<std::shared_ptr<const std::string>, kTopics>;

class KeptPublisher {
 public:
  using FindBlob = std::function<BlobPtr(std::string_view name)>;  // on any thread

  // `refused`: see NatsLink::Events.
  KeptPublisher(const NatsServer& server, const Subjects& subjects, FindBlob find_blob,
                std::function<void(const std::string& why)> refused);
  ~KeptPublisher();
  KeptPublisher(const KeptPublisher&) = delete;
  KeptPublisher& operator=(const KeptPublisher&) = delete;

  void Put(Texts texts);
  // While another gateway publishes the room, or may; so it begins.
  void SetWaits(bool waits);

  bool is_connected() const { return link_.is_connected(); }
  // Why not everything is kept; empty: it is, or is under way.
  std::string problem() const;
  // See Beat::kept.
  std::map<std::string, std::string> kept() const;

 private:
  using Time = std::chrono::steady_clock::time_point;
  // A group that may not be acknowledged yet.
  struct Sent {
    std::uint64_t number = 0;  // of its message
    std::size_t group = 0;
  };
  void Run();
  bool WaitForWork();
  bool Publish();
  bool PublishVolume(const Texts& texts);
  void WaitForAnswers();
  void PublishTexts();
  void Put(const std::string& name, const std::string& subject, const std::string& message);
  bool PublishBlobs(const std::string& manifest_text);
  bool PublishGroups(const Manifest& manifest);
  // The number of its last part; none: it is superseded and gone.
  std::optional<std::uint64_t> PublishBlob(
      const ContentHash& hash, std::uint8_t kind,
      const std::function<std::string(std::uint32_t part)>& subject);
  void TakeAcknowledged();
  void ForgetSent();
  void SetProblem(const std::string& problem);
  void Wake(bool& flag, bool value);

  const Subjects subjects_;
  const FindBlob find_blob_;
  NatsLink link_;
  KeptStream stream_;

  // The publishing thread's. What the stream was given:
  std::string manifest_;  // its name; empty: not whole
  ContentHash overview_{};
  std::vector<ContentHash> groups_;  // zero: background
  bool is_purged_ = false;           // otherwise it may keep other groups, too
  std::deque<Sent> sent_;
  Time look_at_{};                            // whether the stream is still there
  std::shared_ptr<const std::string> tried_;  // the last manifest
  Time retry_at_{};                           // after a refusal; not before, with this manifest
  std::chrono::seconds pause_{0};

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  bool stopping_ = false, waits_ = true;
  bool is_new_ = false;         // texts_
  bool is_connection_ = false;  // a new one: the stream may be another one
  Texts texts_;
  // Given, too, but read by any thread: hashes of topics' messages and of the volume's, by name.
  std::map<std::string, std::string> put_;
  std::string problem_ = "its first copy is under way";
  std::thread thread_;
};

}  // namespace palpate::web
