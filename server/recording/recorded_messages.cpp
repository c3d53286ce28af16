#include "server/recording/recorded_messages.h"

#include <google/protobuf/descriptor.pb.h>

#include <algorithm>
#include <array>
#include <set>
#include <string_view>
#include <utility>
#include <vector>

#include "common/error/error.h"
#include "common/wire/convert.h"
#include "common/wire/values.h"
#include "common/wire/volume_message.h"
#include "server/felt/felt_surface.h"
#include "server/pump/pose_of.h"
#include "server/recording/bytes.h"
#include "server/recording/voxel_log.h"
#include "server/session/setting_checks.h"
#include "server/volume/snapshot/ball.h"
#include "server/volume/snapshot/brick_packer.h"

namespace palpate {
namespace {

// A replay holds many scenes.
constexpr int kMostUnknownSettings = 64;
constexpr std::size_t kMostSourceBytes = std::size_t{16} << 10;
constexpr std::uint64_t kMostBrickNumber = std::uint64_t{1} << 62;

const google::protobuf::FieldDescriptor* Field(std::string_view name) {
  return v1::RenderSettings::descriptor()->FindFieldByName(std::string(name));
}

// Settings that the message lacks keep their defaults: a program that did not know a setting
// behaved so.
void TakeSettings(const v1::RenderSettings& message, RecordedScene& scene) {
  const auto& fields = *message.GetReflection();
  const auto has = [&](std::string_view key) { return fields.HasField(message, Field(key)); };
  scene.settings.refinement = 1;  // as it was before there was the setting
  scene.isovalue = message.isovalue();
  scene.normalized_isovalue = message.normalized_isovalue();
  for (const NumberSetting& setting : kNumberSettings) {
    if (!has(setting.key)) continue;
    scene.settings.*setting.member = fields.GetDouble(message, Field(setting.key));
    if (setting.whole && !setting.Allows(scene.settings.*setting.member)) {
      throw DamagedBytes("damaged: a setting has no whole number");
    }
  }
  for (const FlagSetting& setting : kFlagSettings) {
    if (!has(setting.key)) continue;
    scene.settings.*setting.member = fields.GetBool(message, Field(setting.key));
  }
  for (const ChoiceSetting& setting : kChoiceSettings) {
    if (!has(setting.key)) continue;
    const int number = fields.GetEnumValue(message, Field(setting.key));
    if (number < 1 || number > static_cast<int>(setting.words.size())) {
      throw DamagedBytes("of a choice that this program does not know: a newer one wrote it");
    }
    setting.set(scene.settings, number);
  }
  scene.settings.layers = FromProto(message.layers());
  scene.settings.tool = FromProto(message.tool());
  try {
    OrderLayers({}, scene.settings.layers);
    CheckTool(scene.settings.tool);
  } catch (const Error& error) {
    throw DamagedBytes(std::string("damaged: ") + error.what());
  }
  const google::protobuf::UnknownFieldSet& unknown = fields.GetUnknownFields(message);
  if (unknown.field_count() > kMostUnknownSettings) {
    throw DamagedBytes("damaged: it has too many settings");
  }
  for (int n = 0; n < unknown.field_count(); ++n) {
    scene.unknown_settings.push_back("number " + std::to_string(unknown.field(n).number()));
  }
}

Ball BallOf(const v1::RecordedBall& message) {
  const Ball ball{.radius_mm = message.radius_mm(),
                  .device_from_index = FromProto(message.device_from_index()).linear,
                  .is_least = message.is_least()};
  if (!CanBe(ball)) throw DamagedBytes("damaged: its ball cannot be");
  return ball;
}

void Put(const Ball& ball, v1::RecordedBall& message) {
  message.set_radius_mm(ball.radius_mm);
  *message.mutable_device_from_index() = ToProto(AffineMap{ball.device_from_index, Vec3::Zero()});
  message.set_is_least(ball.is_least);
}

void TakeTool(const v1::RecordedTool& message, RecordedScene& scene) {
  scene.tool = FromProto(message.tool());
  scene.fields.clear();
  for (const v1::RecordedBall& field : message.field()) scene.fields.push_back(BallOf(field));
  const std::vector<double> radii = RadiiOf(scene.tool);
  const auto with_field = std::ranges::count_if(radii, [](double mm) { return mm > 0.0; });
  try {
    CheckTool(scene.tool);
  } catch (const Error&) {
    throw DamagedBytes("damaged: its tool cannot be");
  }
  if (scene.tool.ball.empty() || with_field != std::ssize(scene.fields)) {
    throw DamagedBytes("damaged: its tool has other fields");
  }
}

SafetyLimits SafetyOf(const v1::RecordedSafety& message) {
  return {.max_force_n = message.max_force_n(),
          .max_slew_n_per_s = message.max_slew_n_per_s(),
          .max_torque_n_mm = message.max_torque_n_mm(),
          .max_torque_slew_n_mm_per_s = message.max_torque_slew_n_mm_per_s(),
          .ramp_in_s = message.ramp_in_s(),
          .continuous_force_n = message.continuous_force_n(),
          .continuous_torque_n_mm = message.continuous_torque_n_mm(),
          .thermal_time_s = message.thermal_time_s(),
          .max_speed_mm_per_s = message.max_speed_mm_per_s(),
          .max_turn_rad_per_s = message.max_turn_rad_per_s(),
          .max_missed_ticks = message.max_missed_ticks(),
          .faults_stay = message.faults_stay(),
          .starts_on = message.starts_on(),
          .stop_buttons = message.stop_buttons()};
}

// With structured bindings, the code does not compile until a new limit is stored, too.
void Put(const SafetyLimits& limits, v1::RecordedSafety& message) {
  const auto& [max_force_n, max_slew, max_torque_n_mm, max_torque_slew, ramp_in_s,
               continuous_force_n, continuous_torque_n_mm, thermal_time_s, max_speed, max_turn,
               max_missed_ticks, faults_stay, starts_on, stop_buttons] = limits;
  message.set_max_force_n(max_force_n);
  message.set_max_slew_n_per_s(max_slew);
  message.set_ramp_in_s(ramp_in_s);
  message.set_continuous_force_n(continuous_force_n);
  message.set_thermal_time_s(thermal_time_s);
  message.set_max_speed_mm_per_s(max_speed);
  message.set_max_missed_ticks(max_missed_ticks);
  message.set_faults_stay(faults_stay);
  message.set_starts_on(starts_on);
  message.set_stop_buttons(stop_buttons);
  message.set_max_torque_n_mm(max_torque_n_mm);
  message.set_max_torque_slew_n_mm_per_s(max_torque_slew);
  message.set_continuous_torque_n_mm(continuous_torque_n_mm);
  message.set_max_turn_rad_per_s(max_turn);
}

}  // namespace

v1::RenderSettings ToProto(const RenderSettings& settings) {
  v1::RenderSettings out;
  const auto& fields = *out.GetReflection();
  for (const NumberSetting& setting : kNumberSettings) {
    fields.SetDouble(&out, Field(setting.key), settings.haptics.*setting.member);
  }
  for (const FlagSetting& setting : kFlagSettings) {
    fields.SetBool(&out, Field(setting.key), settings.haptics.*setting.member);
  }
  for (const ChoiceSetting& setting : kChoiceSettings) {
    fields.SetEnumValue(&out, Field(setting.key), setting.get(settings.haptics));
  }
  out.set_isovalue(settings.isovalue);
  out.set_normalized_isovalue(settings.normalized_isovalue);
  if (!settings.haptics.layers.layer.empty()) {
    *out.mutable_layers() = ToProto(settings.haptics.layers);
  }
  if (!settings.haptics.tool.ball.empty()) *out.mutable_tool() = ToProto(settings.haptics.tool);
  return out;
}

v1::RecordedScene ToProto(const RecordedScene& scene) {
  v1::RecordedScene out;
  out.set_tick(scene.tick);
  out.set_scene_revision(scene.scene_revision);
  out.set_settings_revision(scene.settings_revision);
  out.set_volume_revision(scene.volume_revision);
  out.set_loaded_revision(scene.loaded_revision);
  out.set_geometry_revision(scene.geometry_revision);
  *out.mutable_settings() =
      ToProto(RenderSettings{scene.isovalue, scene.normalized_isovalue, scene.settings});
  *out.mutable_device_from_index() = ToProto(scene.X_DI);
  if (scene.X_WI) *out.mutable_world_from_index() = ToProto(*scene.X_WI);
  out.set_volume_source(scene.volume_source);
  out.set_reloadable(scene.reloadable);
  out.set_all_voxels_stored(scene.all_voxels_stored);
  out.set_voxels_missing(scene.voxels_missing);
  out.set_volume_hash_high(scene.volume_hash.high);
  out.set_volume_hash_low(scene.volume_hash.low);
  out.set_size_x(ToCount(scene.size.x()));
  out.set_size_y(ToCount(scene.size.y()));
  out.set_size_z(ToCount(scene.size.z()));
  *out.mutable_spacing_mm() = ToProto(scene.spacing_mm);
  out.set_value_min(scene.value_min);
  out.set_value_max(scene.value_max);
  out.set_is_level_set(scene.is_level_set);
  out.set_tick_period_s(scene.tick_period_s);
  out.set_forces_off(scene.forces_off);
  Put(scene.safety, *out.mutable_safety());
  out.mutable_device()->set_resolution_mm(scene.device.resolution_mm);
  out.mutable_device()->set_max_force_n(scene.device.max_force_n);
  out.mutable_device()->set_tick_s(scene.device.tick_s);
  out.mutable_device()->set_max_torque_n_mm(scene.device.max_torque_n_mm);
  if (scene.series_position_frames) out.set_series_position_frames(*scene.series_position_frames);
  if (!scene.tool.ball.empty()) {
    *out.mutable_tool()->mutable_tool() = ToProto(scene.tool);
    for (const Ball& field : scene.fields) Put(field, *out.mutable_tool()->add_field());
  } else if (!scene.fields.empty()) {
    Put(scene.fields.front(), *out.mutable_ball());
  }
  return out;
}

RecordedScene FromProto(const v1::RecordedScene& in) {
  if (in.volume_source().size() > kMostSourceBytes) {
    throw DamagedBytes("damaged: the name of its volume is too long");
  }
  RecordedScene scene{
      .tick = in.tick(),
      .scene_revision = in.scene_revision(),
      .settings_revision = in.settings_revision(),
      .volume_revision = in.volume_revision(),
      .loaded_revision = in.loaded_revision(),
      .geometry_revision = in.geometry_revision(),
      .X_DI = FromProto(in.device_from_index()),
      .volume_hash = {in.volume_hash_high(), in.volume_hash_low()},
      .volume_source = in.volume_source(),
      .spacing_mm = FromProto(in.spacing_mm()),
      .voxels_missing = in.voxels_missing(),
      .tick_period_s = in.tick_period_s(),
      .safety = in.has_safety() ? SafetyOf(in.safety()) : SafetyLimits(),
      .forces_off = in.forces_off(),
      .reloadable = in.reloadable(),
      .all_voxels_stored = in.all_voxels_stored(),
      .size = Vec3i(FromCount(in.size_x()), FromCount(in.size_y()), FromCount(in.size_z())),
      .value_min = in.value_min(),
      .value_max = in.value_max(),
      .is_level_set = in.is_level_set()};
  if (in.has_world_from_index()) scene.X_WI = FromProto(in.world_from_index());
  if (in.has_series_position_frames()) scene.series_position_frames = in.series_position_frames();
  if (in.has_device()) {
    scene.device = {in.device().resolution_mm(), in.device().max_force_n(), in.device().tick_s(),
                    in.device().max_torque_n_mm()};
  }
  if (in.has_ball()) scene.fields.push_back(BallOf(in.ball()));
  if (in.has_tool()) TakeTool(in.tool(), scene);
  if (!IsDevice(scene.device)) throw DamagedBytes("damaged: its device cannot be");
  TakeSettings(in.settings(), scene);
  return scene;
}

void ForEachPart(const RecordedEdit& edit,
                 const std::function<void(const v1::RecordedVoxels&)>& take) {
  v1::RecordedVoxels part;
  part.set_tick(edit.tick);
  part.set_base_revision(edit.base_revision);
  part.set_volume_revision(edit.volume_revision);
  if (!edit.known.empty()) {
    for (const BrickRun& run : edit.known) {
      v1::BrickRun& added = *part.add_known();
      added.set_first_brick(run.first);
      added.set_bricks(run.count);
    }
    return take(part);
  }
  BrickPacker packer;
  const auto finish = [&] {
    *part.mutable_bricks() = ToProto(packer.Take());
    take(part);
    packer = {};
  };
  for (const RecordedBrick& brick : edit.bricks) {
    if (packer.Add(brick.number, *brick.values)) continue;
    finish();
    packer.Add(brick.number, *brick.values);
  }
  finish();
}

RecordedEdit FromProto(v1::RecordedVoxels&& part) {
  RecordedEdit edit{.tick = part.tick(),
                    .base_revision = part.base_revision(),
                    .volume_revision = part.volume_revision()};
  for (const v1::BrickRun& run : part.known()) {
    edit.known.push_back({run.first_brick(), run.bricks()});
    if (run.bricks() == 0 || run.first_brick() > kMostBrickNumber) {
      throw DamagedBytes("damaged: of bricks that no volume has");
    }
  }
  if (part.has_bricks()) {
    UnpackBricks(FromProto(std::move(*part.mutable_bricks())),
                 [&](std::uint64_t number, LeafPtr values) {
                   edit.bricks.push_back({number, std::move(values)});
                 });
  }
  const std::uint64_t bricks = edit.BrickCount();
  if (bricks == 0 || bricks > VoxelLog::kMaxBricksPerScene)
    throw DamagedBytes("damaged: of too many bricks");
  return edit;
}

namespace {

std::array<double, 3> ArrayOf(const Vec3& v) { return {v.x(), v.y(), v.z()}; }

}  // namespace

RecordedTick RecordedTickOf(const TickSample& sample) {
  RecordedTick tick{.pose = PoseOf(sample),
                    .force_command = sample.force_command,
                    .device_status = sample.device_status,
                    .docked = sample.docked,
                    .calibrated = sample.calibrated,
                    .input_rejected = sample.input_rejected,
                    .scene_revision = sample.scene_revision,
                    .faulty_ticks = sample.faulty_ticks};
  if (sample.is_led()) tick.led_target_mm = Vec3(sample.led_target_mm.data());
  if (sample.is_pushed()) tick.push_n = Vec3(sample.push_n.data());
  if (sample.shows_series()) tick.series_position_frames = sample.series_position_frames;
  return tick;
}

TickSample SampleOf(const RecordedTick& tick) {
  const PoseSample& pose = tick.pose;
  const auto& q = pose.stylus_orientation;
  const Vec3 kNone = Vec3::Constant(TickSample::kNone);
  const UnalignedQuaternion no_tool(TickSample::kNone, TickSample::kNone, TickSample::kNone,
                                    TickSample::kNone);
  const UnalignedQuaternion tool = pose.tool_orientation.value_or(no_tool);
  const TickSample sample{
      .tick = pose.tick,
      .time_ns = pose.time_ns,
      .hip_mm = ArrayOf(pose.hip_mm),
      .scp_h_mm = ArrayOf(pose.scp_h_mm),
      .scp_h_normal = ArrayOf(pose.scp_h_normal.value_or(Vec3::Zero())),
      .scp_v_mm = ArrayOf(pose.scp_v_mm.value_or(Vec3::Zero())),
      .scp_v_normal = ArrayOf(pose.scp_v_normal.value_or(Vec3::Zero())),
      .stylus_orientation = {q.w(), q.x(), q.y(), q.z()},
      .force_n = ArrayOf(pose.force_n),
      .torque_n_mm = ArrayOf(pose.torque_n_mm),
      .led_target_mm = ArrayOf(tick.led_target_mm.value_or(kNone)),
      .push_n = ArrayOf(tick.push_n.value_or(kNone)),
      .tool_orientation = {tool.w(), tool.x(), tool.y(), tool.z()},
      .density = pose.density,
      .isovalue = pose.isovalue,
      .force_limit_n = pose.forces.limit_n,
      .torque_limit_n_mm = pose.forces.torque_limit_n_mm,
      .series_position_frames = tick.series_position_frames.value_or(TickSample::kNone),
      .tool_radius_mm = pose.tool_radius_mm,
      .touching_balls = pose.touching_balls,
      .scene_revision = tick.scene_revision,
      .settings_revision = pose.settings_revision,
      .volume_revision = pose.volume_revision,
      .update_ns = pose.update_ns,
      .missed_ticks = pose.missed_ticks,
      .capped_ticks = pose.capped_ticks,
      .faulty_ticks = tick.faulty_ticks,
      .buttons = pose.buttons,
      .iterations = pose.iterations,
      .refinement = std::max(pose.refinement, 1u),  // recordings before it have none
      .layers_passed = pose.layers_passed,
      .contact_layer = pose.contact_layer,
      .mode = pose.mode,
      .free_side = pose.free_side,
      .contact = pose.contact,
      .has_scp_v = pose.scp_v_mm.has_value(),
      .input_rejected = tick.input_rejected,
      .force_state = pose.forces.state,
      .force_reason = pose.forces.reason,
      .force_command = tick.force_command,
      .device_status = tick.device_status,
      .docked = tick.docked,
      .calibrated = tick.calibrated,
  };
  if (pose.hand != 0) {
    throw DamagedBytes(kSeveralHands);
  }
  if (sample.mode == ProxyMode::kUnknown || sample.free_side == FreeSide::kUnknown ||
      sample.force_state == ForceState::kUnknown || sample.force_reason == ForceReason::kUnknown ||
      sample.force_command == ForceCommand::kUnknown ||
      sample.device_status == DeviceStatus::kUnknown) {
    throw DamagedBytes("damaged: a tick has a word that this program does not know");
  }
  return sample;
}

namespace {

namespace pb = google::protobuf;

// Names of the messages and enumerations that a message holds, itself among them, and their files.
class Needed {
 public:
  void Add(const pb::Descriptor& message) {
    if (!names_.insert(message.full_name()).second) return;
    files_.insert(message.file());
    for (int n = 0; n < message.field_count(); ++n) {
      const pb::FieldDescriptor& field = *message.field(n);
      if (field.message_type()) Add(*field.message_type());
      if (field.enum_type()) Add(*field.enum_type());
    }
  }

  // Adds the file, after those that it needs.
  void Write(const pb::FileDescriptor& file, pb::FileDescriptorSet& set) {
    if (!files_.contains(&file) || !written_.insert(&file).second) return;
    pb::FileDescriptorProto pruned = Pruned(file);
    for (int n = 0; n < file.dependency_count(); ++n) {
      const pb::FileDescriptor& dependency = *file.dependency(n);
      if (files_.contains(&dependency)) pruned.add_dependency(dependency.name());
      Write(dependency, set);
    }
    set.add_file()->Swap(&pruned);
  }

 private:
  void Add(const pb::EnumDescriptor& enumeration) {
    names_.insert(enumeration.full_name());
    files_.insert(enumeration.file());
  }

  pb::FileDescriptorProto Pruned(const pb::FileDescriptor& file) const {
    pb::FileDescriptorProto all, pruned;
    file.CopyTo(&all);
    pruned.set_name(all.name());
    pruned.set_package(all.package());
    pruned.set_syntax(all.syntax());
    for (pb::DescriptorProto& message : *all.mutable_message_type()) {
      if (!names_.contains(all.package() + "." + message.name())) continue;
      message.clear_options();
      for (pb::FieldDescriptorProto& field : *message.mutable_field()) field.clear_options();
      pruned.add_message_type()->Swap(&message);
    }
    for (pb::EnumDescriptorProto& enumeration : *all.mutable_enum_type()) {
      if (!names_.contains(all.package() + "." + enumeration.name())) continue;
      enumeration.clear_options();
      for (auto& value : *enumeration.mutable_value()) value.clear_options();
      pruned.add_enum_type()->Swap(&enumeration);
    }
    return pruned;
  }

  std::set<std::string> names_;
  std::set<const pb::FileDescriptor*> files_, written_;
};

}  // namespace

std::string SchemaOf(const pb::Descriptor& message) {
  Needed needed;
  needed.Add(message);
  pb::FileDescriptorSet set;
  needed.Write(*message.file(), set);
  return set.SerializeAsString();
}

}  // namespace palpate
