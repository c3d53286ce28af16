// The client library's values against the contract's messages.
#include <google/protobuf/descriptor.h>
#include <gtest/gtest.h>

#include "client/sdk/messages.h"
#include "common/error/error.h"

namespace palpate::client {
namespace {

// Every field another value, so that a pair of swapped ones is seen; and a field that
// the library does not know fails.
TEST(SdkMessages, EverySettingIsUpdatedByItsName) {
  SettingsUpdate update;
  update.isovalue = 1.0;
  update.normalized_isovalue = 2.0;
  update.stiffness_n_per_mm = 3.0;
  update.damping_n_s_per_m = 4.0;
  update.method = DecompositionMethod::kBcc;
  update.static_friction = 6.0;
  update.dynamic_friction = 7.0;
  update.viscosity_n_s_per_m = 8.0;
  update.pop_force_n = 9.0;
  update.magnet_force_n = 10.0;
  update.magnet_range_mm = 11.0;
  update.force_shading = true;
  update.passivity_control = true;
  update.free_side = FreeSide::kAbove;
  update.carve_tool = true;
  update.carve_radius_mm = 16.0;
  update.carve_rate_per_s = 17.0;
  update.clutch_tool = true;
  update.expected_revision = 19;
  const v1::UpdateSettingsRequest request = ToProto(update);
  const auto* type = v1::RenderSettings::descriptor();
  ASSERT_EQ(request.update_mask().paths_size(), type->field_count());
  for (const std::string& path : request.update_mask().paths()) {
    const auto* field = type->FindFieldByName(path);
    ASSERT_TRUE(field) << path;
    const v1::RenderSettings& settings = request.settings();
    const auto* values = settings.GetReflection();
    ASSERT_TRUE(values->HasField(settings, field)) << path;
    if (field->cpp_type() == google::protobuf::FieldDescriptor::CPPTYPE_DOUBLE) {
      EXPECT_EQ(values->GetDouble(settings, field), field->number()) << path;
    }
  }
  EXPECT_EQ(request.expected_revision(), 19u);

  const Settings back = FromProto(request.settings(), 5);
  EXPECT_EQ(back.isovalue, 1.0);
  EXPECT_EQ(back.normalized_isovalue, 2.0);
  EXPECT_EQ(back.stiffness_n_per_mm, 3.0);
  EXPECT_EQ(back.damping_n_s_per_m, 4.0);
  EXPECT_EQ(back.method, DecompositionMethod::kBcc);
  EXPECT_EQ(back.static_friction, 6.0);
  EXPECT_EQ(back.dynamic_friction, 7.0);
  EXPECT_EQ(back.viscosity_n_s_per_m, 8.0);
  EXPECT_EQ(back.pop_force_n, 9.0);
  EXPECT_EQ(back.magnet_force_n, 10.0);
  EXPECT_EQ(back.magnet_range_mm, 11.0);
  EXPECT_TRUE(back.force_shading && back.passivity_control && back.carve_tool && back.clutch_tool);
  EXPECT_EQ(back.free_side, FreeSide::kAbove);
  EXPECT_EQ(back.carve_radius_mm, 16.0);
  EXPECT_EQ(back.carve_rate_per_s, 17.0);
  EXPECT_EQ(back.revision, 5u);
}

TEST(SdkMessages, NothingToChangeNamesNothing) {
  EXPECT_EQ(ToProto(SettingsUpdate()).update_mask().paths_size(), 0);
}

TEST(SdkMessages, EnumeratorsOfALaterVersionAreUnknown) {
  v1::PoseSample sample;
  sample.mutable_forces()->set_state(static_cast<v1::ForceState>(77));
  sample.mutable_forces()->set_reason(static_cast<v1::ForceReason>(-3));
  sample.set_mode(static_cast<v1::ProxyMode>(1 << 30));
  const Pose pose = FromProto(sample);
  EXPECT_EQ(pose.forces.state, ForceState::kUnknown);
  EXPECT_EQ(pose.forces.reason, ForceReason::kUnknown);
  EXPECT_EQ(pose.mode, ProxyMode::kUnknown);
  EXPECT_FALSE(pose.scp_h_normal || pose.scp_v_mm || pose.scp_v_normal);
}

TEST(SdkMessages, ABlockOutsideIsRefused) {
  Edit edit;
  edit.shape = Block{Vec3i(-1, 0, 0), Vec3i(1, 1, 1), {1.0f}};
  EXPECT_THROW(ToProto(edit), Error);
}

TEST(SdkMessages, ShapesAreThemselves) {
  Edit edit;
  edit.shape = Capsule{Vec3(1, 2, 3), Vec3(4, 5, 6), 7.0};
  edit.operation = EditOperation::kPaint;
  edit.strength = 0.5;
  v1::EditVolumeRequest request = ToProto(edit);
  EXPECT_EQ(request.capsule().from().y(), 2.0);
  EXPECT_EQ(request.capsule().to().z(), 6.0);
  EXPECT_EQ(request.capsule().radius(), 7.0);
  EXPECT_EQ(request.frame(), v1::EDIT_FRAME_WORLD);
  EXPECT_EQ(request.operation(), v1::EDIT_OPERATION_PAINT);
  edit.shape = Block{Vec3i(1, 2, 3), Vec3i(1, 1, 2), {8.0f, 9.0f}};
  request = ToProto(edit);
  EXPECT_EQ(request.frame(), v1::EDIT_FRAME_INDEX);
  EXPECT_EQ(request.block().min_z(), 3u);
  EXPECT_EQ(request.block().values().size(), 8u);
}

TEST(SdkMessages, AFilterIsSentAsItIs) {
  Filter filter{.kind = FilterKind::kMedian, .width = 3, .iterations = 2};
  v1::FilterVolumeRequest request = ToProto(filter);
  EXPECT_EQ(request.kind(), v1::FILTER_KIND_MEDIAN);
  EXPECT_EQ(request.width(), 3u);
  EXPECT_EQ(request.iterations(), 2u);
  EXPECT_EQ(request.region_case(), v1::FilterVolumeRequest::REGION_NOT_SET);
  EXPECT_FALSE(request.has_expected_revision());
  filter = {.kind = FilterKind::kMean, .width = -1, .iterations = -2};
  filter.region = Sphere{Vec3(1, 2, 3), 4.0};
  filter.expected_revision = 7;
  request = ToProto(filter);
  EXPECT_EQ(request.kind(), v1::FILTER_KIND_MEAN);
  EXPECT_EQ(request.width(), 0u);
  EXPECT_EQ(request.iterations(), 0u);
  EXPECT_EQ(request.sphere().center().y(), 2.0);
  EXPECT_EQ(request.sphere().radius(), 4.0);
  EXPECT_EQ(request.frame(), v1::EDIT_FRAME_WORLD);
  EXPECT_EQ(request.expected_revision(), 7u);
  filter = {.kind = FilterKind::kGaussian, .region = Box{Vec3(1, 2, 3), Vec3(4, 5, 6)}};
  filter.frame = EditFrame::kIndex;
  request = ToProto(filter);
  EXPECT_EQ(request.kind(), v1::FILTER_KIND_GAUSSIAN);
  EXPECT_EQ(request.box().min().z(), 3.0);
  EXPECT_EQ(request.box().max().x(), 4.0);
  EXPECT_EQ(request.frame(), v1::EDIT_FRAME_INDEX);
}

}  // namespace
}  // namespace palpate::client
