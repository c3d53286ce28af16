// What palpate-web sends to guests' browsers and into rooms, as bytes: the contract's own messages
// in an Envelope (palpate/v1/envelope.proto), less what guests may not see.
//
// A field is hidden unless its declaration shows it (guests_see, words.proto). Text that goes to
// guests has no control characters.
//
// Threads: pure. Errors: none. Functions return nothing if the bytes are not such a message.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/contract/pose.h"
#include "common/contract/volume_stream.h"

namespace google::protobuf {
class Message;
}

namespace palpate {

// Clears what guests may not see, and fields of a later version, in all that the message holds.
void HideFromGuests(google::protobuf::Message& message);

struct PoseSending {
  std::int64_t sent_ns = 0;   // the gateway's CLOCK_MONOTONIC
  bool shares_clock = false;  // with palpated
  bool is_fresh = false;      // palpated is connected
};

// Where the sequence number is in the bytes of a pose: four, little-endian.
inline constexpr std::size_t kEnvelopeSequenceOffset = 1;
inline constexpr std::size_t kMostPoseBytes = 4096;

std::string PoseEnvelope(const PoseSample& pose, const PoseSending& sending);
// A pose that another gateway sent, as this one sends it on: fresh if it was and is.
// `shares_clock`: this gateway with the other one, so that the age grows by the way; without, and
// if the two times contradict that, there is no age.
struct PoseOnItsWay {
  std::string bytes{};
  std::optional<double> age_ms{};  // none: not known
};
std::optional<PoseOnItsWay> ForwardedPose(std::string_view envelope, const PoseSending& sending);

// The facts that guests get, by their numbers in Facts.
enum class GuestFact : std::uint8_t {
  kSettings = 1,
  kVolume = 2,
  kSeries = 3,
  kRecording = 4,
  kPlacement = 7,
};

// `facts`: bytes of a Facts message. None: it has no such fact.
std::optional<std::string> FactEnvelope(std::string_view facts, GuestFact fact);
// There is none, or nobody knows: a fact of which no field is set. A volume without a map is none.
std::string NoFactEnvelope(GuestFact fact);
std::string PlacementEnvelope(const VolumePlacement& placement);
// What came in a room, as guests get it. None: it is no envelope of this fact alone.
std::optional<std::string> ForwardedFact(std::string_view envelope, GuestFact fact);

// The message of a room's volume, from envelopes and to envelopes. An empty placement: none.
struct RoomVolumeParts {
  std::string volume{}, placement{}, manifest{};
};
std::string RoomVolumeBytes(const RoomVolumeParts& parts);
std::optional<RoomVolumeParts> ParseRoomVolume(std::string_view bytes);

}  // namespace palpate
