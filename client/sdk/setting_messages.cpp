#include "client/sdk/setting_messages.h"

#include <google/protobuf/descriptor.h>

#include <optional>
#include <string>
#include <variant>

#include "common/wire/values.h"

namespace palpate::client {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Reflection;

// The fields have the settings' keys: both are generated from the same list.
const FieldDescriptor* FieldOf(const Setting& setting) {
  return v1::RenderSettings::descriptor()->FindFieldByName(std::string(setting.key));
}

// Copies a field into a Settings. Returns false for a choice of a later version.
struct Read {
  const v1::RenderSettings& from;
  const Reflection& fields;
  const FieldDescriptor* field;
  Settings& to;

  bool operator()(const NumberSetting& number) const {
    to.*number.member = fields.GetDouble(from, field);
    return true;
  }
  bool operator()(const FlagSetting& flag) const {
    to.*flag.member = fields.GetBool(from, field);
    return true;
  }
  bool operator()(const ChoiceSetting& choice) const {
    const int number = fields.GetEnumValue(from, field);
    if (number < 1 || static_cast<std::size_t>(number) > choice.words.size()) return false;
    choice.set(to, static_cast<std::size_t>(number) - 1);
    return true;
  }
};

// Copies a value of an update into a field. Returns false if the update has no value.
struct Write {
  const SettingsUpdate& from;
  const Reflection& fields;
  const FieldDescriptor* field;
  v1::RenderSettings& to;

  bool operator()(const NumberSetting& number) const {
    const std::optional<double>& value = from.*number.update;
    if (value) fields.SetDouble(&to, field, *value);
    return value.has_value();
  }
  bool operator()(const FlagSetting& flag) const {
    const std::optional<bool>& value = from.*flag.update;
    if (value) fields.SetBool(&to, field, *value);
    return value.has_value();
  }
  bool operator()(const ChoiceSetting& choice) const {
    const std::optional<std::size_t> place = choice.updated(from);
    if (place) fields.SetEnumValue(&to, field, static_cast<int>(*place) + 1);
    return place.has_value();
  }
};

}  // namespace

Settings FromProto(const v1::RenderSettings& settings, std::uint64_t revision,
                   const v1::BallState& ball, bool replayed) {
  Settings result;
  result.revision = revision;
  result.replayed = replayed;
  const Reflection& fields = *settings.GetReflection();
  for (std::size_t n = 0; n < kSettings.size(); ++n) {
    const FieldDescriptor* field = FieldOf(kSettings[n]);
    const bool is_known = fields.HasField(settings, field) &&
                          std::visit(Read{settings, fields, field, result}, kSettings[n].kind);
    result.unknown.set(n, !is_known);
  }
  result.layers = palpate::FromProto(settings.layers());
  result.tool = palpate::FromProto(settings.tool());
  result.ball = palpate::FromProto(ball);
  return result;
}

v1::UpdateSettingsRequest ToProto(const SettingsUpdate& update) {
  v1::UpdateSettingsRequest request;
  v1::RenderSettings& settings = *request.mutable_settings();
  const Reflection& fields = *settings.GetReflection();
  for (const Setting& setting : kSettings) {
    const bool is_changed =
        std::visit(Write{update, fields, FieldOf(setting), settings}, setting.kind);
    if (is_changed) request.mutable_update_mask()->add_paths(std::string(setting.key));
  }
  if (update.layers) {
    *settings.mutable_layers() = palpate::ToProto(*update.layers);
    request.mutable_update_mask()->add_paths("layers");
  }
  if (update.tool) {
    *settings.mutable_tool() = palpate::ToProto(*update.tool);
    request.mutable_update_mask()->add_paths("tool");
  }
  if (update.expected_revision) request.set_expected_revision(*update.expected_revision);
  return request;
}

}  // namespace palpate::client
