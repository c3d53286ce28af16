// What guests' browsers and rooms get of the contract's messages.
#include "client/web/wire/envelope.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>
#include <string>

#include "common/wire/values.h"
#include "palpate/v1/envelope.pb.h"
#include "tests/support/filler.h"

namespace palpate {
namespace {

using google::protobuf::FieldDescriptor;
using testing::Filler;

v1::Envelope Parsed(const std::string& bytes) {
  v1::Envelope envelope;
  EXPECT_TRUE(envelope.ParseFromString(bytes));
  return envelope;
}

// The names of all fields that are set, with those that hold them. Unknown ones: "unknown".
void Collect(const google::protobuf::Message& message, const std::string& prefix,
             std::set<std::string>& names) {
  const auto& fields = *message.GetReflection();
  if (!fields.GetUnknownFields(message).empty()) names.insert(prefix + "unknown");
  std::vector<const FieldDescriptor*> present;
  fields.ListFields(message, &present);
  for (const FieldDescriptor* field : present) {
    const std::string name = prefix + field->name();
    if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) {
      names.insert(name);
    } else if (field->is_repeated()) {
      Collect(fields.GetRepeatedMessage(message, field, 0), name + ".", names);
    } else {
      Collect(fields.GetMessage(message, field), name + ".", names);
    }
  }
}

template <class Message>
Message Filled(int round) {
  Message message;
  Filler(round).Fill(message);
  message.GetReflection()->MutableUnknownFields(&message)->AddVarint(999, 1);
  return message;
}

// What a browser gets, from palpated and by a room, of messages in which every field is set.
std::set<std::string> ShownOfPoses() {
  std::set<std::string> names;
  for (int round = 0; round < Filler::kRounds; ++round) {
    v1::Envelope sent;
    *sent.mutable_pose() = Filled<v1::PoseSample>(round);
    const v1::Envelope got = Parsed(ForwardedPose(sent.SerializeAsString(), {}).value().bytes);
    Collect(got.pose(), "", names);
  }
  return names;
}

std::set<std::string> ShownOfFacts(bool is_room) {
  std::set<std::string> names;
  const auto collect = [&](const std::string& bytes) { Collect(Parsed(bytes).facts(), "", names); };
  for (int round = 0; round < Filler::kRounds; ++round) {
    v1::Envelope sent;
    *sent.mutable_facts() = Filled<v1::Facts>(round);
    for (const GuestFact fact : {GuestFact::kSettings, GuestFact::kVolume, GuestFact::kPlacement,
                                 GuestFact::kSeries, GuestFact::kRecording}) {
      collect((is_room ? ForwardedFact(sent.SerializeAsString(), fact)
                       : FactEnvelope(sent.facts().SerializeAsString(), fact))
                  .value());
    }
    if (!is_room) continue;
    v1::RoomVolume room;
    *room.mutable_facts() = sent.facts();
    const RoomVolumeParts parts = ParseRoomVolume(room.SerializeAsString()).value();
    collect(parts.volume);
    collect(parts.placement);
  }
  return names;
}

std::set<std::string> operator+(std::set<std::string> names, const std::set<std::string>& more) {
  names.insert(more.begin(), more.end());
  return names;
}

std::set<std::string> Vector(const std::string& name) {
  return {name + ".x", name + ".y", name + ".z"};
}

// Written out, so that no change goes unnoticed: whoever shows guests more answers for it.
TEST(Guests, GetWhatIsDeclaredAndNothingElse) {
  const std::set<std::string> pose = Vector("hip_mm") + Vector("scp_h_mm") +
                                     Vector("scp_h_normal") + Vector("scp_v_mm") +
                                     Vector("force_n") + Vector("stylus_orientation") +
                                     std::set<std::string>{"stylus_orientation.w",
                                                           "tick",
                                                           "time_ns",
                                                           "buttons",
                                                           "mode",
                                                           "contact",
                                                           "density",
                                                           "isovalue",
                                                           "settings_revision",
                                                           "volume_revision",
                                                           "update_ns",
                                                           "missed_ticks",
                                                           "free_side",
                                                           "forces.state",
                                                           "forces.reason",
                                                           "forces.limit_n",
                                                           "replayed",
                                                           "refinement",
                                                           "layers_passed",
                                                           "contact_layer",
                                                           "tool_radius_mm",
                                                           "hand",
                                                           "torque_n_mm.x",
                                                           "torque_n_mm.y",
                                                           "torque_n_mm.z",
                                                           "forces.torque_limit_n_mm",
                                                           "tool_orientation.w",
                                                           "tool_orientation.x",
                                                           "tool_orientation.y",
                                                           "tool_orientation.z",
                                                           "touching_balls"};
  EXPECT_EQ(ShownOfPoses(), pose);
  const std::set<std::string> facts = ShownOfFacts(false);
  EXPECT_EQ(ShownOfFacts(true), facts);
  std::set<std::string> others;
  for (const std::string& name : facts) {
    if (!name.starts_with("settings.settings.")) others.insert(name);
  }
  const std::set<std::string> expected =
      Vector("volume.world_from_index.translation") +
      Vector("placement.device_from_index.translation") +
      std::set<std::string>{"settings.settings_revision",
                            "settings.ball.felt_radius_mm",
                            "settings.ball.is_awaited",
                            "settings.ball.share_done",
                            "settings.replayed",
                            "settings.not_kept",
                            "volume.size_x",
                            "volume.size_y",
                            "volume.size_z",
                            "volume.value_min",
                            "volume.value_max",
                            "volume.unit",
                            "volume.world_from_index.linear",
                            "volume.suggested_isovalues.name",
                            "volume.suggested_isovalues.isovalue",
                            "volume.suggested_isovalues.reason",
                            "volume.histogram.low",
                            "volume.histogram.high",
                            "volume.histogram.counts",
                            "volume.name",
                            "volume.voxel_type",
                            "volume.window_level",
                            "volume.window_width",
                            "volume.replayed",
                            "placement.device_from_index.linear",
                            "placement.settings_revision",
                            "placement.patient_axes",
                            "placement.patient_axes_answered",
                            "placement.replayed",
                            "series.frames",
                            "series.position_frames",
                            "series.playing",
                            "series.rate_hz",
                            "series.replayed",
                            "recording.running",
                            "recording.ticks",
                            "recording.lost_ticks"};
  EXPECT_EQ(others, expected);
  // Settings: all, and all of a layer and a tool: its name, length, and a ball's five numbers.
  const int settings = v1::RenderSettings::descriptor()->field_count() - 2;
  const int of_layer = v1::SurfaceLayer::descriptor()->field_count(), of_tool = 2 + 5;
  EXPECT_EQ(facts.size() - others.size(), static_cast<std::size_t>(settings + of_layer + of_tool));
}

TEST(Guests, GetTextWithoutControlCharacters) {
  v1::Facts facts;
  facts.mutable_volume()->set_name("<script>\n\x01\"x.nrrd");
  facts.mutable_volume()->add_suggested_isovalues()->set_reason("a\tb");
  HideFromGuests(facts);
  EXPECT_EQ(facts.volume().name(), "<script>  \"x.nrrd");
  EXPECT_EQ(facts.volume().suggested_isovalues(0).reason(), "a b");
}

PoseSample SomePose() {
  PoseSample pose;
  pose.tick = 123456789012;
  pose.time_ns = 5'000'000'000;
  pose.hip_mm = {1, 2, 3};
  pose.forces.limit_n = 3.25;
  pose.iterations = 7;
  return pose;
}

TEST(PoseEnvelope, HasThePoseItsTimesAndRoomForItsNumber) {
  const std::string bytes =
      PoseEnvelope(SomePose(), {.sent_ns = 5'002'500'000, .shares_clock = true, .is_fresh = true});
  EXPECT_LT(bytes.size(), 400u);
  std::string numbered = bytes;
  numbered.replace(kEnvelopeSequenceOffset, 4, "\x04\x03\x02\x01");
  const v1::Envelope envelope = Parsed(numbered);
  EXPECT_EQ(envelope.sequence(), 0x01020304u);
  EXPECT_EQ(envelope.sent_ms(), 5002.5);
  EXPECT_EQ(envelope.age_ms(), 2.5);
  EXPECT_TRUE(envelope.fresh());
  EXPECT_EQ(envelope.pose().tick(), 123456789012u);
  EXPECT_EQ(envelope.pose().hip_mm().y(), 2.0);
  EXPECT_EQ(envelope.pose().iterations(), 0u);  // hidden
  EXPECT_FALSE(Parsed(PoseEnvelope(SomePose(), {0, false, true})).has_age_ms());
}

TEST(PoseEnvelope, ForwardedHasThisGatewaysTimes) {
  const std::string sent =
      PoseEnvelope(SomePose(), {.sent_ns = 5'002'500'000, .shares_clock = true, .is_fresh = true});
  const auto forward = [&](std::int64_t now_ns, bool shares_clock) {
    return Parsed(ForwardedPose(sent, {now_ns, shares_clock, true}).value().bytes);
  };
  const v1::Envelope near = forward(5'010'000'000, true);
  EXPECT_EQ(near.sent_ms(), 5010.0);
  EXPECT_EQ(near.age_ms(), 10.0);
  EXPECT_EQ(near.pose().SerializeAsString(), Parsed(sent).pose().SerializeAsString());
  EXPECT_FALSE(forward(77'000'000, false).has_age_ms());
  // What was sent later than now was sent by another clock.
  EXPECT_FALSE(forward(5'002'000'000, true).has_age_ms());
}

TEST(PoseEnvelope, ForwardedIsFreshIfItWasAndIs) {
  for (const bool was : {false, true}) {
    for (const bool is : {false, true}) {
      const std::string sent = PoseEnvelope(SomePose(), {0, true, was});
      EXPECT_EQ(Parsed(ForwardedPose(sent, {0, true, is}).value().bytes).fresh(), was && is);
    }
  }
}

TEST(PoseEnvelope, OfNumbersThatAreNoneHasNoAge) {
  const double infinity = std::numeric_limits<double>::infinity();
  for (const double number : {std::nan(""), infinity, -infinity, 1e300, -1e300}) {
    for (const bool is_age : {false, true}) {
      v1::Envelope sent = Parsed(PoseEnvelope(SomePose(), {0, true, true}));
      is_age ? sent.set_age_ms(number) : sent.set_sent_ms(number);
      const v1::Envelope forwarded =
          Parsed(ForwardedPose(sent.SerializeAsString(), {1'000'000, true, true}).value().bytes);
      EXPECT_EQ(forwarded.sent_ms(), 1.0);
      EXPECT_FALSE(forwarded.has_age_ms()) << number;
    }
  }
}

TEST(PoseEnvelope, WhatIsNoneIsNotForwarded) {
  const std::string pose = PoseEnvelope(SomePose(), {0, true, true});
  v1::Envelope without_forces = Parsed(pose);
  without_forces.mutable_pose()->clear_forces();
  for (const std::string& bytes :
       {std::string(), pose.substr(1), pose + '\xff', NoFactEnvelope(GuestFact::kVolume),
        pose + std::string(kMostPoseBytes, '\0'), without_forces.SerializeAsString()}) {
    EXPECT_FALSE(ForwardedPose(bytes, {0, true, true})) << bytes.size();
  }
}

TEST(FactEnvelopes, HaveOneFactEach) {
  v1::Facts facts;
  facts.mutable_settings()->set_settings_revision(4);
  facts.mutable_series()->set_frames(7);
  facts.mutable_recording()->set_path("/secret/a.mcap");
  const std::string bytes = facts.SerializeAsString();
  const v1::Facts series = Parsed(FactEnvelope(bytes, GuestFact::kSeries).value()).facts();
  EXPECT_EQ(series.series().frames(), 7u);
  EXPECT_FALSE(series.has_settings());
  const std::string recording = FactEnvelope(bytes, GuestFact::kRecording).value();
  EXPECT_EQ(recording.find("secret"), std::string::npos);
  EXPECT_FALSE(FactEnvelope(bytes, GuestFact::kVolume));
  EXPECT_FALSE(FactEnvelope("\xff", GuestFact::kSeries));
}

// A room's publisher may be another program.
TEST(FactEnvelopes, ForwardedHaveNoMoreThanGuestsSee) {
  v1::Envelope sent;
  sent.mutable_facts()->mutable_recording()->set_path("/secret/a.mcap");
  sent.mutable_facts()->mutable_recording()->set_running(true);
  sent.mutable_facts()->mutable_caller()->set_identity("secret");
  const std::string forwarded =
      ForwardedFact(sent.SerializeAsString(), GuestFact::kRecording).value();
  EXPECT_EQ(forwarded.find("secret"), std::string::npos);
  EXPECT_TRUE(Parsed(forwarded).facts().recording().running());
  EXPECT_FALSE(ForwardedFact(sent.SerializeAsString(), GuestFact::kSettings));
  EXPECT_FALSE(ForwardedFact(PoseEnvelope(SomePose(), {0, true, true}), GuestFact::kSettings));
}

TEST(RoomVolume, ComesBackInItsParts) {
  v1::Facts facts;
  facts.mutable_volume()->set_name("head.nrrd");
  const std::string volume = FactEnvelope(facts.SerializeAsString(), GuestFact::kVolume).value();
  VolumePlacement placement;
  placement.patient_axes = "RAS";
  for (const std::string& placed : {PlacementEnvelope(placement), std::string()}) {
    const auto parts = ParseRoomVolume(RoomVolumeBytes({volume, placed, "{}"}));
    ASSERT_TRUE(parts);
    EXPECT_EQ(parts->volume, volume);
    EXPECT_EQ(parts->placement, placed);
    EXPECT_EQ(parts->manifest, "{}");
  }
  EXPECT_FALSE(ParseRoomVolume(RoomVolumeBytes({"", "", "{}"})));
  EXPECT_FALSE(ParseRoomVolume("\xff"));
}

}  // namespace
}  // namespace palpate
