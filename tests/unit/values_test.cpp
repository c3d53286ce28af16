// The contract's values against its messages, whose own reflection judges: every field of every
// value, whatever fields the contract has.
#include <google/protobuf/descriptor.h>
#include <gtest/gtest.h>

#include <set>
#include <string>

#include "common/error/error.h"
#include "common/wire/values.h"
#include "palpate/v1/words.pb.h"
#include "tests/support/filler.h"

namespace palpate {
namespace {

using google::protobuf::FieldDescriptor;
using testing::Filler;

// The names of the messages that this one holds, and its own.
void Collect(const google::protobuf::Descriptor& type, std::set<std::string>& names) {
  names.insert(type.full_name());
  for (int n = 0; n < type.field_count(); ++n) {
    if (const auto* held = type.field(n)->message_type()) Collect(*held, names);
  }
}

template <class Type>
class ValuesTest : public ::testing::Test {};
using Messages =
    ::testing::Types<v1::PoseSample, v1::GetDeviceResponse, v1::HandsState, v1::ListedDevice,
                     v1::GetActivityResponse, v1::LoadSeriesResult, v1::ControlSeriesRequest,
                     v1::RecordingState, v1::ReplayResponse, v1::ListRecordingsResponse,
                     v1::GetRegistrationResponse, v1::UpdateRegistrationRequest,
                     v1::UpdateRegistrationResponse, v1::VolumeRevision, v1::VolumeOverview,
                     v1::VolumePlacement, v1::LoadVolumeResult, v1::SaveVolumeResult,
                     v1::EditVolumeResponse, v1::SphereShape, v1::BoxShape, v1::CapsuleShape,
                     v1::EnableForcesResponse, v1::ControlSeriesResponse>;
TYPED_TEST_SUITE(ValuesTest, Messages);

TYPED_TEST(ValuesTest, EveryFieldComesBack) {
  for (int round = 0; round < Filler::kRounds; ++round) {
    TypeParam message;
    Filler(round).Fill(message);
    EXPECT_EQ(ToProto(FromProto(message)).DebugString(), message.DebugString());
  }
}

TYPED_TEST(ValuesTest, WhatIsAbsentStaysAbsentOrIsTheDefault) {
  const TypeParam none;
  const TypeParam back = ToProto(FromProto(none));
  const auto& type = *none.GetDescriptor();
  for (int n = 0; n < type.field_count(); ++n) {
    const FieldDescriptor* field = type.field(n);
    if (!field->has_optional_keyword()) continue;
    EXPECT_FALSE(back.GetReflection()->HasField(back, field)) << field->full_name();
  }
}

template <class... Message>
std::set<std::string> NamesIn(::testing::Types<Message...>) {
  std::set<std::string> names;
  (Collect(*Message::descriptor(), names), ...);
  return names;
}

TEST(Values, AllAreTested) {
  const std::set<std::string> tested = NamesIn(Messages());
  for (const auto* file :
       {v1::PoseSample::descriptor()->file(), v1::ForceStatus::descriptor()->file(),
        v1::LastChange::descriptor()->file(), v1::SeriesState::descriptor()->file(),
        v1::RecordingState::descriptor()->file(), v1::Registration::descriptor()->file(),
        v1::VolumeDescription::descriptor()->file(), v1::VolumePlacement::descriptor()->file(),
        v1::SphereShape::descriptor()->file()}) {
    for (int n = 0; n < file->message_type_count(); ++n) {
      const auto* type = file->message_type(n);
      if (type->options().GetExtension(v1::is_value)) {
        EXPECT_TRUE(tested.count(type->full_name())) << type->full_name();
      }
    }
  }
}

TEST(Values, EnumeratorsOfALaterVersionAreUnknown) {
  v1::PoseSample sample;
  sample.mutable_forces()->set_state(static_cast<v1::ForceState>(77));
  sample.mutable_forces()->set_reason(static_cast<v1::ForceReason>(-3));
  sample.set_mode(static_cast<v1::ProxyMode>(1 << 30));
  const PoseSample pose = FromProto(sample);
  EXPECT_EQ(pose.forces.state, ForceState::kUnknown);
  EXPECT_EQ(pose.forces.reason, ForceReason::kUnknown);
  EXPECT_EQ(pose.mode, ProxyMode::kUnknown);
}

TEST(Values, NumbersOfVoxelsFit) {
  v1::VolumeDescription message;
  message.set_size_y(1U << 31);
  EXPECT_THROW(FromProto(message), Error);
  VolumeDescription value;
  value.size.y() = -1;
  EXPECT_THROW(ToProto(value), Error);
}

}  // namespace
}  // namespace palpate
