// What a room on a NATS server consists of: its subjects, the publisher's heartbeat, and blobs in
// parts.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "client/web/hub/hub.h"
#include "client/web/volume/blob.h"
#include "common/bricks/brick.h"

namespace palpate::web {

// The subjects of a room on a NATS server.
//
//   palpate.R.live.pose        a pose (client/web/wire/envelope.h)
//   palpate.R.live.beat        the publisher's heartbeat
//   palpate.R.kept.text.T      the newest message of a topic: T is connection, copy, settings,
//                              steering, series or recording; as guests get it (hub.h)
//   palpate.R.kept.volume      volume, placement and manifest (RoomVolume of envelope.proto)
//   palpate.R.kept.manifest.N  part N of the manifest (Part)
//   palpate.R.kept.overview.N  part N of the overview
//   palpate.R.kept.group.N     group N of the volume
//   palpate.R.steer.U          requests of NATS user U
//
// The stream of the room keeps the newest message of each kept subject.
//
// Threads: pure. Errors: as stated.

// 1 to 32 of a-z, 0-9, '_' and '-'.
bool IsRoom(std::string_view name);
// 1 to 64 of letters, digits, '_' and '-': one token of a subject.
bool IsNatsUser(std::string_view name);

// The topics whose messages a room keeps each on a subject of its own.
inline constexpr Topic kTextTopics[] = {Topic::kConnection, Topic::kCopy,   Topic::kSettings,
                                        Topic::kSteering,   Topic::kSeries, Topic::kRecording};
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

inline constexpr int kRoomProtocol = 2;
inline constexpr std::chrono::milliseconds kBetweenBeats{500};
inline constexpr std::chrono::seconds kBeatLife{3};  // without a beat: the publisher is away

// The heartbeat of a room's publisher: says that it is there, and who it is. JSON:
//   {"protocol": 2, "session": 16 hex digits, random at each start, "machine": 32 hex digits,
//    "kept": {"settings": 32 hex digits, ..., "volume": ...}}
// kept: NameOf the KeptHash of the newest messages that this session has put; a topic's name, or
// "volume" for the volume's message. A receiver that has another one has missed it: a leaf server
// loses messages while its link is cut.
struct Beat {
  int protocol = kRoomProtocol;
  std::string session{};
  std::string machine{};
  std::map<std::string, std::string> kept{};
};

std::string ToJson(const Beat& beat);
// None: no beat. Of another protocol, the other members may be empty.
std::optional<Beat> ParseBeat(std::string_view json);

ContentHash KeptHash(std::string_view subject, std::string_view message);

// Equal where CLOCK_MONOTONIC is the same: a hash of this start of this machine.
std::string ThisMachine();

inline constexpr std::uint8_t kManifestKind = 255;
inline constexpr std::size_t kMostSlice = std::size_t{512} << 10;
// zstd bytes are a little longer than what they hold, if that is random.
inline constexpr std::uint16_t kMostParts = Blob::kMostBytes / kMostSlice + 1;

// Blobs as a room keeps them: zstd bytes in parts, each of which fits a NATS message.
//
//   at   type   what
//     0  u8     1: version
//     1  u8     LeafType of the voxels; 255: a manifest
//     2  u16    number of the part
//     4  u16    parts of the blob
//     6  16 B   hash of the kind and the plain bytes (BytesOf), which is the blob's name
//    22         a slice of the blob's zstd frame, at most kMostSlice
//
// Little-endian. A group has one part. A hash of zeros and no bytes: a group of background.
//
// Threads: pure. Errors: as stated.
struct Part {
  std::uint8_t kind = 0;
  std::uint16_t number = 0;
  std::uint16_t count = 1;
  ContentHash hash{};
  std::string_view slice;  // borrowed
};

// None: no part, or of another version. Borrows the bytes.
std::optional<Part> DecodePart(std::string_view bytes);

// All parts of a blob of this kind, encoded. Errors: kTooLarge if there are more than kMostParts.
std::vector<std::string> PartsOf(std::uint8_t kind, const ContentHash& hash, std::string_view zstd);
// What stands for a group of background.
std::string BackgroundPart();

// The plain bytes. Errors: kInvalidArgument if `zstd` holds more than `most` bytes, if it is longer
// than they need, or if `hash` is not that of its bytes under this kind.
std::string VerifiedBytes(std::uint8_t kind, const ContentHash& hash, std::string_view zstd,
                          std::size_t most);

// Puts parts of the newest blob together.
class PartsAssembler {
 public:
  // Takes a part. Of another blob than the last one, or of another count: begins anew with it.
  // Returns the blob's zstd bytes if this was the last part that was missing, and begins anew.
  std::optional<std::string> Take(const Part& part);
  void Clear();

  // Of the blob that is begun; zeros: none.
  const ContentHash& hash() const { return hash_; }
  // Numbers of its parts that did not come yet.
  std::vector<std::uint16_t> Missing() const;

 private:
  ContentHash hash_{};
  std::uint8_t kind_ = 0;
  std::vector<std::string> slices_;  // empty: missing
  std::size_t missing_ = 0;
};

}  // namespace palpate::web
