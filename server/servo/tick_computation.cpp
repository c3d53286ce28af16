#include "server/servo/tick_computation.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "server/servo/servo_memory.h"

namespace palpate {
namespace {

std::array<double, 3> ToArray(const Vec3& v) { return {v.x(), v.y(), v.z()}; }

void DescribeTool(const ToolOutput& output, const ToolMemory& memory, TickSample& sample) {
  const Eigen::Quaterniond& q = output.tool.pose.R_DS;
  sample.tool_orientation = {q.w(), q.x(), q.y(), q.z()};
  sample.touching_balls = output.tool.touching;
  sample.contact = output.tool.touching != 0;
  sample.refinement = static_cast<std::uint32_t>(memory.felt.refinement);
}

void Describe(const Scene& scene, const HapticOutput& output, TickSample& sample) {
  sample.hip_mm = ToArray(output.p_DHip_mm);
  sample.scp_h_mm = ToArray(output.proxy.p_DH_mm);
  sample.scp_h_normal = ToArray(output.proxy.normal_D);
  sample.mode = output.proxy.mode;
  sample.free_side = output.free_side;
  sample.layers_passed = static_cast<std::uint32_t>(output.layers_passed);
  sample.contact_layer = static_cast<std::uint32_t>(output.contact_layer);
  if (scene.ball) sample.tool_radius_mm = scene.ball->radius_mm;
  sample.contact = !output.proxy.normal_D.isZero();
  sample.input_rejected = output.input_rejected;
  sample.density = scene.volume->Denormalize(output.proxy.density);
  sample.iterations = static_cast<std::uint32_t>(output.proxy.moves);
}

// In data units, as it was asked for: one that glides is on its way.
double IsovalueOf(const Scene& scene, double felt) {
  const HapticSurface& surface = scene.surface;
  if (surface.layers == nullptr && felt == surface.isovalue) return scene.isovalue;
  if (surface.layers != nullptr) {
    for (const HapticLayer& layer : surface.layers->all()) {
      if (layer.isovalue == felt) return layer.asked_isovalue;
    }
  }
  return scene.volume->Denormalize(surface.sign() * felt);
}

// Where SCP_V looks for V: with the sign of the side that is felt.
SurfacePlace PlaceOf(const Proxy& proxy) {
  if (!proxy.on_surface()) return {};
  const Place& place = proxy.place;
  return {.isovalue = proxy.contact == Contact::kLower ? -proxy.lower : proxy.isovalue,
          .cell = {place.cell.x(), place.cell.y(), place.cell.z()},
          .vertex_count = static_cast<std::uint8_t>(place.carrier.count),
          .vertex = place.carrier.vertex,
          .weight = place.carrier.weight};
}

}  // namespace

PassivityDevice PassivityDeviceOf(const DeviceDescription& spec) {
  PassivityDevice device{.tick_s = kTickPeriodS};
  if (spec.position_resolution_mm > 0.0) device.resolution_mm = spec.position_resolution_mm;
  if (spec.max_force_n > 0.0) device.max_force_n = spec.max_force_n;
  device.max_torque_n_mm = std::max(0.0, spec.max_torque_n_mm);
  return device;
}

TickSample TickComputation::Run(const Scene& scene, const TickInput& input) noexcept {
  TickSample sample;
  sample.tick = ticks_++;
  sample.missed_ticks = input.missed_ticks;
  sample.isovalue = scene.isovalue;
  sample.settings_revision = scene.settings_revision;
  sample.scene_revision = scene.scene_revision;
  sample.volume_revision = scene.volume->revision();

  // Missed ticks lengthen the time in which the stylus has moved.
  const std::uint64_t missed = input.missed_ticks - missed_ticks_;
  const double elapsed_s = kTickPeriodS * (1.0 + static_cast<double>(missed));
  missed_ticks_ = input.missed_ticks;
  // Another refinement would move the surface under the stylus.
  HapticSurface surface = scene.surface;
  if (renderer_.proxy.on_surface() && renderer_.proxy.refinement != surface.lattice.refinement()) {
    surface.Refine(renderer_.proxy.refinement);
  }
  if (std::exchange(resumed_, false) && !Fits(surface, renderer_.proxy, renderer_.cache)) {
    renderer_.proxy = Proxy();
    surface = scene.surface;
  }

  const HandInput& stylus = input.stylus;
  const bool suspended = scene.forces_off || stylus.docked || !stylus.calibrated ||
                         (scene.settings.clutch_tool && (stylus.buttons & kClutchButton) != 0);
  const bool pushed = !std::isnan(input.push_D_n.x());
  was_pushed_ = pushed && !suspended;
  HapticOutput output;
  std::optional<ToolOutput> with_tool;
  if (suspended || pushed || scene.tool == nullptr) tool_ = ToolMemory();
  if (suspended || pushed) {
    output = SuspendRenderer(stylus.p_DHip_mm, elapsed_s, renderer_);
    if (pushed) output.force_D_n = input.push_D_n;
  } else if (scene.tool != nullptr) {
    with_tool = StepWithTool(scene.tool->felt, scene.settings, stylus.p_DHip_mm, stylus.R_DS,
                             elapsed_s, kToolWork, renderer_, tool_);
    output = with_tool->haptic;
    if (renderer_.has_hip) sample.isovalue = IsovalueOf(scene, output.isovalue);
  } else {
    output = StepRenderer(surface, scene.settings, stylus.p_DHip_mm, elapsed_s, renderer_);
    if (renderer_.has_hip) sample.isovalue = IsovalueOf(scene, output.isovalue);
  }
  Describe(scene, output, sample);
  sample.surface_place = PlaceOf(renderer_.proxy);
  sample.refinement = static_cast<std::uint32_t>(surface.lattice.refinement());
  if (with_tool) DescribeTool(*with_tool, tool_, sample);
  if (suspended || pushed) {
    sample.mode = ProxyMode::kSuspended;
    sample.free_side = surface.free_side;
  }
  const Wrench wanted_D = {output.force_D_n, with_tool ? with_tool->torque_D_n_mm : Vec3::Zero()};
  const Wrench wrench_D = safety_.Step({.wrench_D = wanted_D,
                                        .p_DHip_mm = output.p_DHip_mm,
                                        .R_DS = stylus.R_DS,
                                        .device = input.device,
                                        .docked = stylus.docked,
                                        .calibrated = stylus.calibrated,
                                        .position_rejected = output.input_rejected,
                                        .suspended = suspended,
                                        .pushed = pushed,
                                        .buttons = stylus.buttons,
                                        .command = input.command,
                                        .missed_ticks = missed},
                                       kTickPeriodS);
  if (safety_.faulty()) {
    sample.mode = ProxyMode::kFault;
    ++faulty_ticks_;
  }
  if (with_tool) {
    TellWrittenWrench(wrench_D, scene.tool->felt.tool.rotation_length_mm, renderer_, tool_);
  } else {
    TellWrittenForce(wrench_D.force_n, renderer_);
  }
  capped_ticks_ += output.proxy.capped;
  sample.faulty_ticks = faulty_ticks_;
  sample.capped_ticks = capped_ticks_;
  sample.force_n = ToArray(wrench_D.force_n);
  sample.torque_n_mm = ToArray(wrench_D.torque_n_mm);
  sample.push_n = ToArray(input.push_D_n);
  sample.force_limit_n = safety_.limit_n();
  sample.torque_limit_n_mm = safety_.torque_limit_n_mm();
  sample.force_state = safety_.state();
  sample.force_reason = safety_.reason();
  sample.force_command = input.command;
  sample.device_status = input.device;
  sample.docked = stylus.docked;
  sample.calibrated = stylus.calibrated;
  sample.buttons = stylus.buttons;
  const Eigen::Quaterniond& q = stylus.R_DS;
  sample.stylus_orientation = {q.w(), q.x(), q.y(), q.z()};
  sample.led_target_mm = ToArray(stylus.p_DLed_mm);
  if (scene.series_position_frames) sample.series_position_frames = *scene.series_position_frames;
  return sample;
}

TickInput TickComputation::InputOf(const TickSample& sample) const noexcept {
  TickInput input;
  const auto& q = sample.stylus_orientation;
  input.stylus.p_DHip_mm = Vec3(sample.hip_mm.data());
  if (sample.input_rejected) {
    input.stylus.p_DHip_mm.setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  input.stylus.R_DS = Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
  input.stylus.buttons = sample.buttons;
  input.stylus.docked = sample.docked;
  input.stylus.calibrated = sample.calibrated;
  input.stylus.p_DLed_mm = Vec3(sample.led_target_mm.data());
  input.device = sample.device_status;
  input.command = sample.force_command;
  input.push_D_n = Vec3(sample.push_n.data());
  input.missed_ticks = sample.missed_ticks;
  return input;
}

ServoKeyframe TickComputation::Keyframe() const noexcept {
  return Save(
      {renderer_, tool_, safety_.memory(), ticks_, missed_ticks_, capped_ticks_, faulty_ticks_});
}

bool TickComputation::Resume(std::string_view keyframe) noexcept {
  ServoMemory memory;
  if (!Load(keyframe, memory)) return false;
  static_cast<RendererMemory&>(renderer_) = memory.renderer;
  tool_ = memory.tool;
  safety_.Resume(memory.safety);
  resumed_ = true;
  ticks_ = memory.tick;
  missed_ticks_ = memory.missed_ticks;
  capped_ticks_ = memory.capped_ticks;
  faulty_ticks_ = memory.faulty_ticks;
  return true;
}

}  // namespace palpate
