#include "client/cli/setting.h"

#include <fmt/core.h>
#include <google/protobuf/descriptor.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

namespace palpate::cli {
namespace {

using google::protobuf::EnumDescriptor;
using google::protobuf::EnumValueDescriptor;
using google::protobuf::FieldDescriptor;

const FieldDescriptor* Field(const Setting& setting) {
  return v1::RenderSettings::descriptor()->FindFieldByName(std::string(setting.key));
}

// FREE_SIDE_BELOW is "below", DECOMPOSITION_METHOD_TPBCC_PUBLISHED is
// "tpbcc-published"; each enumeration begins with its ..._UNSPECIFIED.
std::string NameOf(const EnumValueDescriptor& value) {
  const std::string& first = value.type()->value(0)->name();
  std::string name = value.name().substr(first.size() - std::string_view("UNSPECIFIED").size());
  std::transform(name.begin(), name.end(), name.begin(), [](char letter) {
    return letter == '_' ? '-' : static_cast<char>(letter | 0x20);  // lower case in ASCII
  });
  return name;
}

// Null: none of that name.
const EnumValueDescriptor* ValueNamed(const EnumDescriptor& type, const std::string& name) {
  for (int n = 1; n < type.value_count(); ++n) {
    if (NameOf(*type.value(n)) == name) return type.value(n);
  }
  return nullptr;
}

std::optional<double> ParseNumber(const std::string& text) {
  double value = 0.0;
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || rest != end || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::optional<bool> ParseFlag(const std::string& text) {
  if (text == "on" || text == "true") return true;
  if (text == "off" || text == "false") return false;
  return std::nullopt;
}

}  // namespace

const Setting* FindSetting(std::string_view name) {
  const auto matches = [name](const Setting& s) { return s.name == name || s.key == name; };
  for (const Setting* isovalue : {&kIsovalue, &kNormalizedIsovalue}) {
    if (matches(*isovalue)) return isovalue;
  }
  const auto found = std::find_if(kSettings.begin(), kSettings.end(), matches);
  return found == kSettings.end() ? nullptr : &*found;
}

bool StoreSetting(const Setting& setting, const std::string& text, v1::RenderSettings& settings) {
  const FieldDescriptor* field = Field(setting);
  const auto& fields = *settings.GetReflection();
  if (field->cpp_type() == FieldDescriptor::CPPTYPE_DOUBLE) {
    const std::optional<double> number = ParseNumber(text);
    if (number) fields.SetDouble(&settings, field, *number);
    return number.has_value();
  }
  if (field->cpp_type() == FieldDescriptor::CPPTYPE_BOOL) {
    const std::optional<bool> flag = ParseFlag(text);
    if (flag) fields.SetBool(&settings, field, *flag);
    return flag.has_value();
  }
  const EnumValueDescriptor* value = ValueNamed(*field->enum_type(), text);
  if (value) fields.SetEnum(&settings, field, value);
  return value != nullptr;
}

nlohmann::ordered_json SettingJson(const Setting& setting, const v1::RenderSettings& settings) {
  const FieldDescriptor* field = Field(setting);
  const auto& fields = *settings.GetReflection();
  if (!fields.HasField(settings, field)) return nullptr;
  switch (field->cpp_type()) {
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return fields.GetDouble(settings, field);
    case FieldDescriptor::CPPTYPE_BOOL:
      return fields.GetBool(settings, field);
    default:
      // A newer daemon may have values that are unknown here.
      const EnumValueDescriptor* value =
          field->enum_type()->FindValueByNumber(fields.GetEnumValue(settings, field));
      return value ? NameOf(*value) : "unknown";
  }
}

std::string DescribeSetting(const Setting& setting, const v1::RenderSettings& settings) {
  const nlohmann::ordered_json value = SettingJson(setting, settings);
  std::string text = "unknown";
  if (value.is_number()) text = fmt::format("{:.9g}{}", value.get<double>(), setting.unit);
  if (value.is_boolean()) text = value.get<bool>() ? "on" : "off";
  if (value.is_string()) text = value.get<std::string>();
  return fmt::format("{} {}", setting.name, text);
}

bool IsOff(const Setting& setting, const v1::RenderSettings& settings) {
  const nlohmann::ordered_json value = SettingJson(setting, settings);
  return value == 0.0 || value == false;
}

}  // namespace palpate::cli
