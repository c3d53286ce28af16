// The client library's values against the contract's messages.
#include <google/protobuf/descriptor.h>
#include <gtest/gtest.h>

#include <string>
#include <variant>

#include "client/sdk/messages.h"
#include "common/error/error.h"

namespace palpate::client {
namespace {

// Puts a value into an update that tells its field from all others.
struct Put {
  SettingsUpdate& update;
  int number;

  void operator()(const NumberSetting& s) const { update.*s.update = number; }
  void operator()(const FlagSetting& s) const { update.*s.update = true; }
  void operator()(const ChoiceSetting& s) const { s.update(update, s.words.size() - 1); }
};

// Whether it is what Put put.
struct Is {
  const Settings& settings;
  int number;

  bool operator()(const NumberSetting& s) const { return settings.*s.member == number; }
  bool operator()(const FlagSetting& s) const { return settings.*s.member; }
  bool operator()(const ChoiceSetting& s) const { return s.get(settings) == s.words.size() - 1; }
};

// Every field another value, so that a pair of swapped ones is seen; and a field that
// the library does not know fails.
TEST(SdkMessages, EverySettingIsUpdatedByItsName) {
  const auto* type = v1::RenderSettings::descriptor();
  ASSERT_EQ(static_cast<int>(kSettings.size()) + 2, type->field_count());  // layers, tool
  SettingsUpdate update;
  update.layers = SurfaceLayers{{{.id = 3, .name = "skin", .isovalue = -300.0}}};
  update.tool = HeldTool{.name = "drill", .ball = {{Vec3(1, 2, 3), 1.5, true}}};
  for (const Setting& setting : kSettings) {
    const auto* field = type->FindFieldByName(std::string(setting.key));
    ASSERT_TRUE(field) << setting.key;
    std::visit(Put{update, field->number()}, setting.kind);
  }
  update.expected_revision = 19;
  const v1::UpdateSettingsRequest request = ToProto(update);
  ASSERT_EQ(request.update_mask().paths_size(), type->field_count());
  const v1::RenderSettings& settings = request.settings();
  for (const std::string& path : request.update_mask().paths()) {
    const auto* field = type->FindFieldByName(path);
    ASSERT_TRUE(field) << path;
    const auto* values = settings.GetReflection();
    ASSERT_TRUE(values->HasField(settings, field)) << path;
    if (field->cpp_type() == google::protobuf::FieldDescriptor::CPPTYPE_DOUBLE) {
      EXPECT_EQ(values->GetDouble(settings, field), field->number()) << path;
    } else if (field->enum_type()) {
      EXPECT_EQ(values->GetEnumValue(settings, field), field->enum_type()->value_count() - 1)
          << path;
    }
  }
  EXPECT_EQ(request.expected_revision(), 19u);

  const Settings back = FromProto(settings, 5);
  for (const Setting& setting : kSettings) {
    const auto* field = type->FindFieldByName(std::string(setting.key));
    EXPECT_TRUE(IsKnown(back, setting)) << setting.key;
    EXPECT_TRUE(std::visit(Is{back, field->number()}, setting.kind)) << setting.key;
  }
  EXPECT_EQ(back.layers, update.layers);
  EXPECT_EQ(back.tool, update.tool);
  EXPECT_EQ(back.revision, 5u);
}

TEST(SdkMessages, WhatADaemonDoesNotSayIsUnknown) {
  v1::RenderSettings message;
  message.set_isovalue(0.0);
  message.set_method(static_cast<v1::DecompositionMethod>(77));
  message.set_free_side(v1::FREE_SIDE_UNSPECIFIED);
  const Settings settings = FromProto(message, 1);
  for (const Setting& setting : kSettings) {
    EXPECT_EQ(IsKnown(settings, setting), &setting == &kIsovalue) << setting.key;
  }
  EXPECT_EQ(settings.method, DecompositionMethod::kTpbcc);
  EXPECT_EQ(settings.stiffness_n_per_mm, 0.5);
}

TEST(SdkMessages, ShapesAreThemselves) {
  Edit edit;
  edit.shape = Capsule{Vec3(1, 2, 3), Vec3(4, 5, 6), 7.0};
  edit.operation = EditOperation::kPaint;
  edit.strength = 0.5;
  edit.stroke = 7;
  v1::EditVolumeRequest request = ToProto(edit);
  EXPECT_EQ(request.capsule().radius(), 7.0);
  EXPECT_EQ(request.frame(), v1::EDIT_FRAME_WORLD);
  EXPECT_EQ(request.operation(), v1::EDIT_OPERATION_PAINT);
  EXPECT_EQ(request.stroke(), 7u);
  edit.shape = Block{Vec3i(1, 2, 3), Vec3i(1, 1, 2), {8.0f, 9.0f}};
  request = ToProto(edit);
  EXPECT_EQ(request.frame(), v1::EDIT_FRAME_INDEX);
  EXPECT_EQ(request.block().min_z(), 3u);
  EXPECT_EQ(request.block().values().size(), 8u);
  edit.shape = Block{Vec3i(-1, 0, 0), Vec3i(1, 1, 1), {1.0f}};
  EXPECT_THROW(ToProto(edit), Error);
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
  EXPECT_EQ(request.sphere().radius(), 4.0);
  EXPECT_EQ(request.frame(), v1::EDIT_FRAME_WORLD);
  EXPECT_EQ(request.expected_revision(), 7u);
  filter = {.kind = FilterKind::kGaussian, .region = Box{Vec3(1, 2, 3), Vec3(4, 5, 6)}};
  filter.frame = EditFrame::kIndex;
  request = ToProto(filter);
  EXPECT_EQ(request.kind(), v1::FILTER_KIND_GAUSSIAN);
  EXPECT_EQ(request.box().max().x(), 4.0);
  EXPECT_EQ(request.frame(), v1::EDIT_FRAME_INDEX);
}

}  // namespace
}  // namespace palpate::client
