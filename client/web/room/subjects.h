// The subjects of a room on a NATS server.
//
//   palpate.R.live.pose        a pose (client/web/wire/envelope.h)
//   palpate.R.live.beat        the publisher's heartbeat
//   palpate.R.kept.text.T      the newest message of a topic: T is connection, settings, steering,
//                              series or recording; as guests get it (hub.h)
//   palpate.R.kept.volume      volume, placement and manifest (RoomVolume of envelope.proto)
//   palpate.R.kept.manifest.N  part N of the manifest (part.h)
//   palpate.R.kept.overview.N  part N of the overview
//   palpate.R.kept.group.N     group N of the volume
//   palpate.R.steer.U          requests of NATS user U
//
// The stream of the room keeps the newest message of each kept subject.
//
// Threads: pure. Errors: as stated.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "client/web/hub/hub.h"

namespace palpate::web {

// 1 to 32 of a-z, 0-9, '_' and '-'.
bool IsRoom(std::string_view name);
// 1 to 64 of letters, digits, '_' and '-': one token of a subject.
bool IsNatsUser(std::string_view name);

// The topics whose messages a room keeps each on a subject of its own.
inline constexpr Topic kTextTopics[] = {Topic::kConnection, Topic::kSettings, Topic::kSteering,
                                        Topic::kSeries, Topic::kRecording};
// "connection", "volume", ...: the topic's name.
std::string_view NameOf(Topic topic);

// What a kept subject stands for.
struct Kept {
  enum class Kind { kText, kVolume, kManifest, kOverview, kGroup };
  Kind kind = Kind::kText;
  std::uint32_t number = 0;          // of a part or group
  Topic topic = Topic::kConnection;  // of a text
  friend bool operator==(const Kept&, const Kept&) = default;
};

class Subjects {
 public:
  // Errors: kInvalidArgument if `room` is none.
  explicit Subjects(const std::string& room);

  const std::string& room() const { return room_; }
  std::string pose() const { return prefix_ + "live.pose"; }
  std::string beat() const { return prefix_ + "live.beat"; }
  std::string text(Topic topic) const { return kept_ + "text." + std::string(NameOf(topic)); }
  std::string volume() const { return kept_ + "volume"; }
  std::string manifest(std::uint32_t part) const { return Numbered("manifest.", part); }
  std::string overview(std::uint32_t part) const { return Numbered("overview.", part); }
  std::string group(std::uint32_t number) const { return Numbered("group.", number); }
  std::string steer(const std::string& user) const { return prefix_ + "steer." + user; }

  // Patterns.
  std::string live_all() const { return prefix_ + "live.>"; }
  std::string kept_all() const { return kept_ + ">"; }
  std::string group_all() const { return kept_ + "group.>"; }
  std::string steer_all() const { return prefix_ + "steer.*"; }

  // JetStream's.
  std::string stream() const { return "PALPATE_" + room_; }
  // A request to it is answered by the newest message of this kept subject.
  std::string direct_get(const std::string& subject) const {
    return "$JS.API.DIRECT.GET." + stream() + "." + subject;
  }

  std::string SubjectOf(const Kept& kept) const;
  // None: no kept subject of this room.
  std::optional<Kept> ParseKept(std::string_view subject) const;
  // The NATS user of a steer subject of this room; none: no such subject.
  std::optional<std::string> ParseSteer(std::string_view subject) const;

 private:
  std::string Numbered(std::string_view name, std::uint32_t number) const {
    return kept_ + std::string(name) + std::to_string(number);
  }

  std::string room_;
  std::string prefix_;  // "palpate.R."
  std::string kept_;    // "palpate.R.kept."
};

// Inboxes of a user's connections begin with this and a dot, so that no user hears another's.
std::string InboxPrefix(const std::string& user);

}  // namespace palpate::web
