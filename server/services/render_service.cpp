#include "server/services/render_service.h"

#include <fmt/ranges.h>

#include <string>
#include <vector>

#include "common/contract/registration.h"
#include "common/error/error.h"
#include "common/wire/convert.h"
#include "common/wire/status.h"
#include "common/wire/values.h"
#include "server/client_paths/series_files.h"
#include "server/log/log.h"
#include "server/realtime/tick_timer.h"
#include "server/recording/recorded_messages.h"
#include "server/services/volume_messages.h"

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

namespace {

Registration RegistrationOf(const VolumeState& state) {
  const VolumePlace& place = state.registration;
  return {place.p_DCenter_mm, UnalignedQuaternion(place.R_DW), place.device_mm_per_volume_mm,
          DeviceMmPerVoxel(place, state.volume->metadata())};
}

}  // namespace

Reply* RegistrationService::GetRegistration(CallContext* context,
                                            const v1::GetRegistrationRequest* request,
                                            v1::GetRegistrationResponse* response) {
  return calls_.Answer(context, "/palpate.v1.RegistrationService/GetRegistration", *request,
                       *response, [=, this](const Admission&) {
                         const VolumeState state = session_.shown().volume();
                         *response->mutable_registration() = ToProto(RegistrationOf(state));
                         response->set_settings_revision(state.settings_revision);
                         response->set_replayed(state.replayed);
                       });
}

Reply* RegistrationService::UpdateRegistration(CallContext* context,
                                               const v1::UpdateRegistrationRequest* request,
                                               v1::UpdateRegistrationResponse* response) {
  return calls_.Answer(
      context, "/palpate.v1.RegistrationService/UpdateRegistration", *request, *response,
      [=, this](const Admission& by) {
        const UpdateRegistrationRequest update = FromProto(*request);
        const auto change = [&](const VolumeState& state) {
          return Apply(update, state.volume->metadata(), session_.device(), state.registration);
        };
        const VolumeState state = session_.Move(change, update.expected_revision, update.facing);
        by.Changed("placement");
        const AppliedTick applied = session_.WaitForServo(state.scene_revision);
        *response->mutable_registration() = ToProto(RegistrationOf(state));
        response->set_settings_revision(state.settings_revision);
        response->set_applied_tick(applied.tick);
        response->set_not_kept(state.move_problem.empty() ? session_.AwaitPlaceKept()
                                                          : state.move_problem);
      });
}

namespace {

// The title in the volume's description.
std::string Title(const std::vector<std::string>& sources) {
  return sources.size() == 1 ? sources.front() : sources.front() + " ...";
}

}  // namespace

EventStream<v1::LoadSeriesResponse>* SeriesService::LoadSeries(
    CallContext* context, const v1::LoadSeriesRequest* request) {
  return calls_.Stream<v1::LoadSeriesResponse>(
      context, "/palpate.v1.SeriesService/LoadSeries",
      [=, this](auto& events, const auto& cancelled) {
        const std::vector<std::string> sources(request->sources().begin(),
                                               request->sources().end());
        const auto files = FindSeriesFiles(sources, paths_);
        LoadRequest load = FromProto(request->options());
        load.title = Title(sources);
        const VolumeState state = player_.Load(files, load, ProgressTo(events), cancelled,
                                               SettingsOf(request->options()));
        events.admission().Changed("volume");
        const AppliedTick applied = session_.WaitForServo(state.scene_revision);
        v1::LoadSeriesResponse event;
        SetResult(session_, state, applied, *event.mutable_result());
        *event.mutable_result()->mutable_series() = ToProto(player_.state());
        LogInfo("loaded a series of {} frames, {} (volume revision {}) at tick {}",
                event.result().series().frames(), load.title, state.volume->revision(),
                applied.tick);
        events.Send(std::move(event));
      });
}

Reply* SeriesService::GetSeries(CallContext* context, const v1::GetSeriesRequest* request,
                                v1::GetSeriesResponse* response) {
  return calls_.Answer(
      context, "/palpate.v1.SeriesService/GetSeries", *request, *response,
      [=, this](const Admission&) { *response->mutable_series() = ToProto(player_.state()); });
}

Reply* SeriesService::ControlSeries(CallContext* context, const v1::ControlSeriesRequest* request,
                                    v1::ControlSeriesResponse* response) {
  return calls_.Answer(
      context, "/palpate.v1.SeriesService/ControlSeries", *request, *response,
      [=, this](const Admission& by) {
        const SeriesControlled controlled = player_.Control(FromProto(*request));
        by.Changed("series");
        response->set_applied_tick(session_.WaitForServo(controlled.scene_revision).tick);
        *response->mutable_series() = ToProto(controlled.series);
      });
}

}  // namespace palpate
