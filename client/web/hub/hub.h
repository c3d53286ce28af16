// The newest of everything that guests are told: one message per topic, and one pose. Messages are
// bytes of an Envelope (client/web/wire/envelope.h), or JSON of what only the gateway knows.
//
// A subscriber is a guest's connection. It learns that a topic or the pose is new and reads the
// newest when it can write. So a slow guest skips values and costs no memory.
//
// Threads: the network thread only. Ownership: borrows subscribers until Unsubscribe. A subscriber
// may subscribe and unsubscribe, itself or others, while it is told of something.
// Errors: none.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "client/web/volume/blob.h"
#include "client/web/wire/envelope.h"

namespace palpate::web {

enum class Topic {
  kConnection,
  kVolume,
  kPlacement,
  kCopy,
  kManifest,
  kSettings,
  kSteering,
  kSeries,
  kRecording,
  kGuests,
};
inline constexpr int kTopics = 10;

// The fact that the topic's messages are envelopes of. None: they are JSON with the topic's name as
// "type".
constexpr std::optional<GuestFact> FactOf(Topic topic) {
  switch (topic) {
    case Topic::kVolume:
      return GuestFact::kVolume;
    case Topic::kPlacement:
      return GuestFact::kPlacement;
    case Topic::kSettings:
      return GuestFact::kSettings;
    case Topic::kSeries:
      return GuestFact::kSeries;
    case Topic::kRecording:
      return GuestFact::kRecording;
    default:
      return std::nullopt;
  }
}

// A guest's change of a setting, or emergency stop (client::kStopKey). Flags are 0 or 1, choices
// the number of their word.
struct SteerRequest {
  std::string user;
  std::string key;
  double value = 0.0;
};

class Subscriber {
 public:
  virtual void OnTopic(Topic topic) = 0;
  virtual void OnPose() = 0;
  // False: not counted, such as one that passes everything on.
  virtual bool is_guest() const { return true; }

 protected:
  ~Subscriber() = default;
};

class Hub {
 public:
  Hub() = default;
  Hub(const Hub&) = delete;
  Hub& operator=(const Hub&) = delete;

  // Tells subscribers if the message is another one.
  void Put(Topic topic, std::string message);
  // Writes the pose's sequence number into its bytes (kEnvelopeSequenceOffset).
  void PutPose(std::string bytes);

  // Null before the first Put.
  std::shared_ptr<const std::string> Newest(Topic topic) const;
  // Null before the first pose.
  std::shared_ptr<const std::string> pose() const { return pose_; }
  // 0 before the first pose; wraps around.
  std::uint32_t pose_sequence() const { return sequence_; }

  void Subscribe(Subscriber* subscriber);
  void Unsubscribe(Subscriber* subscriber);
  // The number of subscribers that are guests. The topic kGuests follows it.
  int guests() const;

  // What the rest of the program offers to guests' connections. Set before the first of them; all
  // are called on the network thread.
  // The blob of this name; null: it is not kept (any more). May be called on any thread.
  std::function<BlobPtr(std::string_view name)> find_blob;
  // `done` is called on the network thread, once; "" if the setting has the value now.
  std::function<void(SteerRequest, std::function<void(std::string error)> done)> steer;
  // "" if all is well, otherwise why not.
  std::function<std::string()> health;
  // The text of `hello` for this user.
  std::function<std::string(const std::string& user, const std::vector<std::string>& may_steer)>
      hello;

 private:
  void Tell(const std::function<void(Subscriber&)>& call);
  void CountGuests();

  std::array<std::shared_ptr<const std::string>, kTopics> newest_;
  std::shared_ptr<const std::string> pose_;
  std::uint32_t sequence_ = 0;
  std::vector<Subscriber*> subscribers_;  // null: unsubscribed while others were told
  int telling_ = 0;
};

}  // namespace palpate::web
