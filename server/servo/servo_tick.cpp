#include "server/servo/servo_tick.h"

namespace palpate {
namespace {

std::array<double, 3> ToArray(const Vec3& v) { return {v.x(), v.y(), v.z()}; }

TickMode ToTickMode(ProxyMode mode) {
  switch (mode) {
    case ProxyMode::kFree:
      return TickMode::kFree;
    case ProxyMode::kConstrained:
      return TickMode::kConstrained;
    case ProxyMode::kEjecting:
      return TickMode::kEjecting;
    case ProxyMode::kFault:
      return TickMode::kFault;
  }
  return TickMode::kFault;
}

void Describe(const Scene& scene, const HapticOutput& output, TickSample& sample) {
  sample.hip_mm = ToArray(output.p_DHip_mm);
  sample.scp_h_mm = ToArray(output.proxy.p_DH_mm);
  sample.scp_h_normal = ToArray(output.proxy.normal_D);
  sample.mode = ToTickMode(output.proxy.mode);
  sample.free_side = output.free_side;
  sample.contact = !output.proxy.normal_D.isZero();
  sample.input_rejected = output.input_rejected;
  sample.has_scp_v = output.visual.found;
  sample.scp_v_mm = ToArray(output.visual.p_DV_mm);
  sample.scp_v_normal = ToArray(output.visual.normal_D);
  sample.density = scene.volume->Denormalize(output.proxy.density);
  sample.iterations = static_cast<std::uint32_t>(output.proxy.moves);
}

}  // namespace

ServoTick::ServoTick(HapticDevice& device)
    : device_(device), safety_(SafetyLimits{.max_force_n = device.spec().max_force_n}) {}

TickSample ServoTick::Run(const Scene& scene, const TickTime& time) noexcept {
  TickSample sample;
  sample.tick = ticks_++;
  sample.time_ns = time.started_ns;
  sample.missed_ticks = time.missed;
  sample.isovalue = scene.isovalue;
  sample.settings_revision = scene.settings_revision;
  sample.scene_revision = scene.scene_revision;
  sample.volume_revision = scene.volume->revision();

  // Missed ticks lengthen the time over which the stylus has moved.
  const double elapsed_s = kTickPeriodS * (1.0 + static_cast<double>(time.missed - missed_ticks_));
  missed_ticks_ = time.missed;

  const DeviceStatus status = device_.Read(stylus_);
  const std::int64_t before_ns = MonotonicNowNs();
  const bool suspended =
      scene.forces_off || (scene.settings.clutch_tool && (stylus_.buttons & kClutchButton) != 0);
  const HapticOutput output = suspended ? SuspendRenderer(stylus_.p_DHip_mm, elapsed_s, renderer_)
                                        : StepRenderer(scene.surface, scene.settings,
                                                       stylus_.p_DHip_mm, elapsed_s, renderer_);
  Describe(scene, output, sample);
  if (suspended) {
    sample.mode = TickMode::kSuspended;
    sample.free_side = scene.settings.free_side;
  }
  const std::uint64_t faults_before = safety_.faults();
  Vec3 force_D_n = safety_.Limit(output.force_D_n, kTickPeriodS);
  if (status != DeviceStatus::kOk || output.input_rejected || suspended) {
    force_D_n = safety_.CutOff();
  }
  if (status != DeviceStatus::kOk || output.input_rejected || safety_.faults() != faults_before) {
    sample.mode = TickMode::kFault;
    ++faulty_ticks_;
  }
  TellWrittenForce(force_D_n, renderer_);
  sample.faulty_ticks = faulty_ticks_;
  sample.update_ns = MonotonicNowNs() - before_ns;
  device_.Write(force_D_n, kTickPeriodS);

  capped_ticks_ += output.proxy.capped;
  sample.capped_ticks = capped_ticks_;
  sample.force_n = ToArray(force_D_n);
  sample.buttons = stylus_.buttons;
  const Eigen::Quaterniond& q = stylus_.R_DS;
  sample.stylus_orientation = {q.w(), q.x(), q.y(), q.z()};
  return sample;
}

}  // namespace palpate
