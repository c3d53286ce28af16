// What a receiving gateway has of a room: a mirror of the messages that the room's stream keeps.
//
// New messages come live. What is missing is asked for: after a connection, and where a manifest
// names a blob that did not come. The publisher publishes a volume's message after all blobs that
// its manifest names; the volume is shown when the copy holds all of them. Until then the last one
// stays. Each blob is verified: its bytes have the hash that is its name.
//
// Live messages of a connection come in the publisher's order. So while none is lost, each volume
// is complete when its message comes. While the copy begins, newer groups may take the place of
// those that a manifest names; one of the next manifests is complete then.
//
// A publisher is trusted with memory: its groups may be as many as those of the largest lattice,
// each as long as zstd's bytes of random voxels, whether or not a manifest names them.
//
// Threads: Find on any; all else one at a time. Time is passed in. Errors: kInvalidArgument of the
// constructor (no room); bad messages are dropped.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "client/web/hub/hub.h"
#include "client/web/room/room_protocol.h"
#include "client/web/volume/blob.h"
#include "client/web/volume/manifest.h"
#include "client/web/wire/envelope.h"

namespace palpate::web {

class RoomCopy {
 public:
  using Time = BlobShelf::Time;

  // The messages of the topics kVolume, kPlacement and kManifest, which change together.
  using Shown = RoomVolumeParts;  // placement: may be empty
  // What is new: messages of topics as guests get them.
  struct News {
    std::optional<Shown> shown;
    std::vector<std::pair<Topic, std::string>> texts;
  };

  static constexpr std::uint32_t kMostGroups = 1U << 21;  // a manifest's 2^36 voxels
  static constexpr std::size_t kMostTextBytes = std::size_t{1} << 20;

  // A new copy has everything to ask for.
  explicit RoomCopy(const std::string& room);

  // A message that came by the subscription of kept_all(), in the order in which they came.
  News TakeLive(std::string_view subject, std::string_view bytes, Time now);
  // The answer to an ask. Empty: nothing is kept there. Ignored if a live message of this subject
  // came since the ask; but not if it was asked for twice, until a beat tells.
  News TakeAnswer(std::string_view subject, std::string_view bytes, Time now);

  // Subjects to ask for now, so that at most so many asks are under way; counts them as asked.
  std::vector<std::string> Asks(std::size_t most);
  // Asks that are under way are lost. `everything`: messages may be lost, too, as after a
  // connection. Otherwise: call it if something is missing and no answer came for a second.
  void AskAnew(bool everything);
  // Beat::kept of the publisher's newest beat. If two in a row name the same messages that did not
  // come here, asks anew for these and returns true; ever more seldom, up to once a minute, while
  // that changes nothing. (One beat may come before a message that it names.)
  bool TakeBeat(const std::map<std::string, std::string>& kept, Time now);
  // Drops blobs that were superseded long ago; Take does so, too.
  void Expire(Time now) { shelf_.Expire(now); }

  // Groups that the newest volume lacks; 0 while its manifest is missing, too.
  std::size_t missing_groups() const { return next_ ? missing_ : 0; }
  // The room was asked, and what it has is shown.
  bool is_complete() const;

  BlobPtr Find(std::string_view name) const { return shelf_.Find(name); }
  const BlobShelf& shelf() const { return shelf_; }

 private:
  enum class Ask : std::uint8_t { kNo, kUnderWay, kDone };  // kDone: not again until AskAnew
  // A topic's message or the volume's.
  struct Text {
    Kept kept;
    ContentHash hash{};  // zeros: nothing is kept
    Ask ask = Ask::kNo;
  };
  // The manifest or the overview.
  struct Parted {
    Kept::Kind kind;
    ContentHash held{};  // the newest whole one; zeros: none
    PartsAssembler parts{};
    std::map<std::uint16_t, Ask> asked{};  // by number of the part
  };
  struct Group {
    ContentHash held{};  // zeros: background, or not known
    Ask ask = Ask::kNo;
  };
  struct Volume {
    Shown texts;
    ContentHash manifest{};
  };

  News Take(std::string_view subject, std::string_view bytes, bool is_live, Time now);
  bool IsNewest(const Kept& kept, std::string_view subject, std::string_view bytes, bool is_live);
  static std::optional<Volume> VolumeOf(std::string_view bytes);
  void TakeVolume(std::string_view bytes, News& news);
  void TakePart(Parted& parted, std::uint32_t number, std::string_view bytes, bool is_live,
                Time now);
  void Hold(Parted& parted, const Part& part, std::string zstd, Time now);
  void TakeGroup(std::uint32_t number, std::string_view bytes, bool is_live, Time now);
  bool UseGroup(const Part& part);
  void Replace(ContentHash& held, const ContentHash& hash, Time now);
  bool IsMissing(std::uint32_t number) const;
  void Compare(Time now);
  void ShowNext(Time now, News& news);
  void UseShown(Time now);
  std::vector<std::uint16_t> PartsToAsk(const Parted& parted, const ContentHash& wanted) const;

  const Subjects subjects_;
  BlobShelf shelf_;
  std::vector<Text> texts_;                    // the volume's message first
  std::size_t under_way_ = 0;                  // asks
  std::map<std::string, std::string> missed_;  // of the newest beat
  Time asked_anew_;                            // because of a beat
  std::chrono::seconds patience_{0};           // until the next time
  Parted manifest_{.kind = Kept::Kind::kManifest};
  Parted overview_{.kind = Kept::Kind::kOverview};
  Manifest newest_;                    // of manifest_.held
  std::vector<Group> groups_;          // by number
  std::size_t missing_ = 0;            // groups that newest_ names and groups_ lacks
  std::vector<std::uint32_t> to_ask_;  // of these; the next one last
  std::optional<Volume> next_;         // the newest volume, if it is not shown
  Manifest shown_;                     // the newest manifest shown
  ContentHash shown_name_{};           // its name; zeros: none
};

}  // namespace palpate::web
