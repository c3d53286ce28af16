// Settings on the wire: every field goes to the session and comes back.
#include "server/services/render_service.h"

#include <gtest/gtest.h>

#include "common/error/error.h"
#include "server/recording/recorded_messages.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using testing::Refusal;

// No two values alike, none a default.
RenderSettings UnlikeAnyDefault() {
  RenderSettings settings;
  double value = 0.0;
  for (const NumberSetting& setting : kNumberSettings) {
    settings.haptics.*setting.member = value += 0.11;
  }
  for (const FlagSetting& setting : kFlagSettings) settings.haptics.*setting.member = true;
  settings.haptics.free_side = FreeSide::kAbove;
  settings.haptics.method = DecompositionMethod::kBcc;
  settings.haptics.layers.layer = {{.id = 3, .name = "skin", .isovalue = -300.0}};
  settings.haptics.tool = {.name = "drill", .ball = {{Vec3(1, 2, 3), 1.5, true}}};
  settings.isovalue = -200.0;
  settings.normalized_isovalue = 0.25;
  return settings;
}

v1::UpdateSettingsRequest RequestOf(const RenderSettings& settings, const std::string& path) {
  v1::UpdateSettingsRequest request;
  *request.mutable_settings() = ToProto(settings);
  request.mutable_update_mask()->add_paths(path);
  return request;
}

TEST(RenderService, EachMaskTakesItsFieldAlone) {
  const RenderSettings settings = UnlikeAnyDefault();
  const auto* fields = v1::RenderSettings::descriptor();
  for (int n = 0; n < fields->field_count(); ++n) {
    const std::string& name = fields->field(n)->name();
    SCOPED_TRACE(name);
    const SettingsUpdate update = FromProto(RequestOf(settings, name));
    const std::size_t taken = update.isovalue.has_value() + update.normalized_isovalue.has_value() +
                              update.numbers.size() + update.flags.size() + update.choices.size() +
                              update.layers.has_value() + update.tool.has_value();
    EXPECT_EQ(taken, 1u);
  }
  for (const NumberSetting& setting : kNumberSettings) {
    const SettingsUpdate update = FromProto(RequestOf(settings, std::string(setting.key)));
    EXPECT_EQ(update.numbers.at(0), std::pair(setting.member, settings.haptics.*setting.member));
  }
  for (const FlagSetting& setting : kFlagSettings) {
    const SettingsUpdate update = FromProto(RequestOf(settings, std::string(setting.key)));
    EXPECT_EQ(update.flags.at(0), std::pair(setting.member, true));
  }
  for (const ChoiceSetting& setting : kChoiceSettings) {
    const SettingsUpdate update = FromProto(RequestOf(settings, std::string(setting.key)));
    EXPECT_EQ(update.choices.at(0), std::pair(&setting, setting.get(settings.haptics)));
  }
  EXPECT_EQ(FromProto(RequestOf(settings, "layers")).layers, settings.haptics.layers);
  EXPECT_EQ(FromProto(RequestOf(settings, "tool")).tool, settings.haptics.tool);
  EXPECT_EQ(FromProto(RequestOf(settings, "isovalue")).isovalue, -200.0);
  EXPECT_EQ(FromProto(RequestOf(settings, "normalized_isovalue")).normalized_isovalue, 0.25);
}

TEST(RenderService, ANameWithoutAValueIsRefused) {
  const auto* fields = v1::RenderSettings::descriptor();
  for (int n = 0; n < fields->field_count(); ++n) {
    v1::UpdateSettingsRequest request;
    request.mutable_update_mask()->add_paths(fields->field(n)->name());
    EXPECT_EQ(Refusal([&] { FromProto(request); }), ErrorKind::kInvalidArgument)
        << fields->field(n)->name();
  }
}

TEST(RenderService, UnknownNamesAndValuesAreRefused) {
  for (const char* path : {"", "friction", "settings.method", "Method"}) {
    EXPECT_EQ(Refusal([&] { FromProto(RequestOf({}, path)); }), ErrorKind::kInvalidArgument)
        << path;
  }
  for (const int side : {0, 3, -1}) {
    v1::UpdateSettingsRequest request = RequestOf({}, "free_side");
    request.mutable_settings()->set_free_side(static_cast<v1::FreeSide>(side));
    EXPECT_EQ(Refusal([&] { FromProto(request); }), ErrorKind::kInvalidArgument) << side;
  }
  // One unknown name spoils the request.
  v1::UpdateSettingsRequest request = RequestOf({}, "pop_force_n");
  EXPECT_FALSE(Refusal([&] { FromProto(request); }).has_value());
  request.mutable_update_mask()->add_paths("colour");
  EXPECT_EQ(Refusal([&] { FromProto(request); }), ErrorKind::kInvalidArgument);
}

}  // namespace
}  // namespace palpate
