#include "server/services/render_service.h"

#include <fmt/ranges.h>

#include "common/error/error.h"
#include "common/wire/convert.h"
#include "common/wire/status.h"
#include "common/wire/values.h"
#include "server/realtime/tick_timer.h"
#include "server/recording/recorded_messages.h"

namespace palpate {
namespace {

// The fields of haptic settings have the names of the tables in settings.h. Returns null if no
// field has this name.
const google::protobuf::FieldDescriptor* Field(std::string_view name) {
  return v1::RenderSettings::descriptor()->FindFieldByName(std::string(name));
}

// Takes the value of a field that the tables name. Returns false if the tables do not name the
// field.
bool TakeListed(const v1::RenderSettings& in, std::string_view name, SettingsUpdate& update) {
  const auto& fields = *in.GetReflection();
  for (const NumberSetting& setting : kNumberSettings) {
    if (setting.key != name) continue;
    update.numbers.emplace_back(setting.member, fields.GetDouble(in, Field(name)));
    return true;
  }
  for (const FlagSetting& setting : kFlagSettings) {
    if (setting.key != name) continue;
    update.flags.emplace_back(setting.member, fields.GetBool(in, Field(name)));
    return true;
  }
  for (const ChoiceSetting& setting : kChoiceSettings) {
    if (setting.key != name) continue;
    const int number = fields.GetEnumValue(in, Field(name));
    if (number < 1 || number > static_cast<int>(setting.words.size())) {
      Refuse(fmt::format("unknown {}: give {}", name, fmt::join(setting.words, " or ")));
    }
    update.choices.emplace_back(&setting, number);
    return true;
  }
  return false;
}

void Take(const v1::RenderSettings& in, const std::string& name, SettingsUpdate& update) {
  const auto* field = Field(name);
  if (field && !in.GetReflection()->HasField(in, field)) {
    Refuse("update_mask names " + name + ", which has no value");
  }
  if (name == "isovalue") {
    update.isovalue = in.isovalue();
  } else if (name == "normalized_isovalue") {
    update.normalized_isovalue = in.normalized_isovalue();
  } else if (name == "layers") {
    update.layers = FromProto(in.layers());
  } else if (name == "tool") {
    update.tool = FromProto(in.tool());
  } else if (!TakeListed(in, name, update)) {
    Refuse("update_mask names an unknown field: " + name);
  }
}

}  // namespace

SettingsUpdate FromProto(const v1::RenderSettings& settings,
                         const google::protobuf::FieldMask& update_mask) {
  SettingsUpdate update;
  for (const std::string& name : update_mask.paths()) Take(settings, name, update);
  return update;
}

SettingsUpdate FromProto(const v1::UpdateSettingsRequest& request) {
  SettingsUpdate update = FromProto(request.settings(), request.update_mask());
  if (request.update_mask().paths().empty()) {
    Refuse("update_mask is empty: name the fields to change");
  }
  if (request.has_expected_revision()) update.expected_revision = request.expected_revision();
  return update;
}

Reply* RenderService::GetSettings(CallContext* context, const v1::GetSettingsRequest* request,
                                  v1::GetSettingsResponse* response) {
  return calls_.Answer(context, "/palpate.v1.RenderService/GetSettings", *request, *response,
                       [=, this](const Admission&) {
                         const SettingsState state = session_.shown().settings();
                         *response->mutable_settings() = ToProto(state.settings);
                         response->set_settings_revision(state.settings_revision);
                         *response->mutable_ball() = ToProto(session_.shown().ball());
                         response->set_replayed(state.replayed);
                       });
}

Reply* RenderService::UpdateSettings(CallContext* context, const v1::UpdateSettingsRequest* request,
                                     v1::UpdateSettingsResponse* response) {
  return calls_.Answer(context, "/palpate.v1.RenderService/UpdateSettings", *request, *response,
                       [=, this](const Admission& by) {
                         const std::int64_t received_ns = MonotonicNowNs();
                         const SettingsApplied result = session_.Update(FromProto(*request));
                         *response->mutable_settings() = ToProto(result.state.settings);
                         response->set_settings_revision(result.state.settings_revision);
                         *response->mutable_ball() = ToProto(session_.ball());
                         response->set_applied_tick(result.applied.tick);
                         response->set_receipt_to_applied_ns(result.applied.time_ns - received_ns);
                         for (const std::string& name : request->update_mask().paths()) {
                           by.Changed(name == "normalized_isovalue" ? "isovalue" : name);
                         }
                         metrics_.SettingsFelt(result.applied.time_ns - received_ns);
                         response->set_not_kept(session_.AwaitSettingsKept());
                       });
}

}  // namespace palpate
