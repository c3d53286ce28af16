#include "client/web/wire/envelope.h"

#include <google/protobuf/message.h>

#include <limits>
#include <utility>
#include <vector>

#include "common/error/text.h"
#include "common/wire/values.h"
#include "palpate/v1/envelope.pb.h"

namespace palpate {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

constexpr double kMostMs = 1e12;  // more is no time

double InMs(std::int64_t ns) { return 1e-6 * static_cast<double>(ns); }

// protobuf takes sizes as int.
bool Parse(std::string_view bytes, Message& message) {
  return bytes.size() <= std::numeric_limits<int>::max() &&
         message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
}

void HideWithin(Message& message, const FieldDescriptor& field) {
  const Reflection& fields = *message.GetReflection();
  const int count = field.is_repeated() ? fields.FieldSize(message, &field) : 1;
  for (int n = 0; n < count; ++n) {
    if (field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
      HideFromGuests(field.is_repeated() ? *fields.MutableRepeatedMessage(&message, &field, n)
                                         : *fields.MutableMessage(&message, &field));
    } else if (field.is_repeated()) {
      fields.SetRepeatedString(&message, &field, n,
                               OneLine(fields.GetRepeatedString(message, &field, n)));
    } else {
      fields.SetString(&message, &field, OneLine(fields.GetString(message, &field)));
    }
  }
}

// A page cannot draw another one, and would not acknowledge it.
bool IsWhole(const v1::PoseSample& pose) {
  return pose.has_hip_mm() && pose.has_scp_h_mm() && pose.has_stylus_orientation() &&
         pose.has_force_n() && pose.has_forces();
}

std::string BytesOf(v1::Facts facts) {
  HideFromGuests(facts);
  v1::Envelope envelope;
  *envelope.mutable_facts() = std::move(facts);
  return envelope.SerializeAsString();
}

const FieldDescriptor* FieldOf(GuestFact fact) {
  return v1::Facts::descriptor()->FindFieldByNumber(static_cast<int>(fact));
}

// Only this fact of them; none: they have no such fact.
std::optional<std::string> OneOf(v1::Facts& facts, GuestFact fact) {
  const FieldDescriptor* const field = FieldOf(fact);
  if (!facts.GetReflection()->HasField(facts, field)) return std::nullopt;
  v1::Facts one;
  facts.GetReflection()->SwapFields(&facts, &one, {field});
  return BytesOf(std::move(one));
}

}  // namespace

void HideFromGuests(Message& message) {
  const Reflection& fields = *message.GetReflection();
  fields.MutableUnknownFields(&message)->Clear();
  std::vector<const FieldDescriptor*> present;
  fields.ListFields(message, &present);
  for (const FieldDescriptor* field : present) {
    if (!field->options().GetExtension(v1::guests_see)) {
      fields.ClearField(&message, field);
    } else if (field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE ||
               field->cpp_type() == FieldDescriptor::CPPTYPE_STRING) {
      HideWithin(message, *field);
    }
  }
}

std::string PoseEnvelope(const PoseSample& pose, const PoseSending& sending) {
  v1::Envelope envelope;
  envelope.set_sequence(1);  // the hub writes it: zero would not be in the bytes
  envelope.set_sent_ms(InMs(sending.sent_ns));
  if (sending.shares_clock) envelope.set_age_ms(InMs(sending.sent_ns - pose.time_ns));
  envelope.set_fresh(sending.is_fresh);
  *envelope.mutable_pose() = ToProto(pose);
  HideFromGuests(*envelope.mutable_pose());
  return envelope.SerializeAsString();
}

std::optional<PoseOnItsWay> ForwardedPose(std::string_view bytes, const PoseSending& sending) {
  v1::Envelope envelope;
  if (bytes.size() > kMostPoseBytes || !Parse(bytes, envelope) || !IsWhole(envelope.pose())) {
    return std::nullopt;
  }
  const double sent_ms = InMs(sending.sent_ns);
  const double way_ms = sent_ms - envelope.sent_ms();
  const double age_ms = envelope.age_ms() + way_ms;
  const bool is_known = envelope.has_age_ms() && sending.shares_clock && way_ms >= 0.0 &&
                        age_ms >= way_ms && age_ms < kMostMs;
  envelope.set_sequence(1);
  envelope.set_sent_ms(sent_ms);
  envelope.clear_age_ms();
  if (is_known) envelope.set_age_ms(age_ms);
  envelope.set_fresh(envelope.fresh() && sending.is_fresh);
  HideFromGuests(*envelope.mutable_pose());
  envelope.DiscardUnknownFields();
  return PoseOnItsWay{envelope.SerializeAsString(),
                      is_known ? std::optional(age_ms) : std::nullopt};
}

std::optional<std::string> FactEnvelope(std::string_view bytes, GuestFact fact) {
  v1::Facts facts;
  if (!Parse(bytes, facts)) return std::nullopt;
  return OneOf(facts, fact);
}

std::string NoFactEnvelope(GuestFact fact) {
  v1::Facts facts;
  facts.GetReflection()->MutableMessage(&facts, FieldOf(fact));
  return BytesOf(std::move(facts));
}

std::string PlacementEnvelope(const VolumePlacement& placement) {
  v1::Facts facts;
  *facts.mutable_placement() = ToProto(placement);
  return BytesOf(std::move(facts));
}

std::optional<std::string> ForwardedFact(std::string_view bytes, GuestFact fact) {
  v1::Envelope envelope;
  if (!Parse(bytes, envelope)) return std::nullopt;
  return OneOf(*envelope.mutable_facts(), fact);
}

std::string RoomVolumeBytes(const RoomVolumeParts& parts) {
  v1::RoomVolume room;
  for (const std::string* part : {&parts.volume, &parts.placement}) {
    v1::Envelope envelope;
    if (Parse(*part, envelope)) room.mutable_facts()->MergeFrom(envelope.facts());
  }
  room.set_manifest(parts.manifest);
  return room.SerializeAsString();
}

std::optional<RoomVolumeParts> ParseRoomVolume(std::string_view bytes) {
  v1::RoomVolume room;
  if (!Parse(bytes, room)) return std::nullopt;
  auto volume = OneOf(*room.mutable_facts(), GuestFact::kVolume);
  if (!volume) return std::nullopt;
  return RoomVolumeParts{*std::move(volume),
                         OneOf(*room.mutable_facts(), GuestFact::kPlacement).value_or(""),
                         std::move(*room.mutable_manifest())};
}

}  // namespace palpate
