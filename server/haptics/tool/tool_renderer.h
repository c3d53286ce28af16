// One haptic update with a tool: from the stylus's pose to the tool's pose, and to the force and
// the torque about the HIP.
//
// Of the settings, stiffness, damping, viscosity and passivity control act. Pops, layers, friction,
// grain, the magnet and force shading do not; the session refuses them with a tool. The coupling
// that turns the tool back has the stiffness times ρ². A device without torque gets the force alone
// (tool_memory.h says at what share).
//
// Frame: D (mm, N, N mm). Threads: pure; one thread per state.
// Real-time: no allocation, no locks; bounded by the work that is given.
#pragma once

#include "common/geometry/wrench.h"
#include "server/haptics/renderer.h"
#include "server/haptics/tool/tool_memory.h"
#include "server/haptics/tool/tool_step.h"

namespace palpate {

// A tool with the surfaces that it is felt on. Borrows the caches.
struct FeltTool {
  RigidTool tool;
  std::array<HapticSurface, kMostToolRadii> surface;  // the first radius_count
  std::array<ToolCellCache*, kMostToolRadii> cache{};
};

struct ToolOutput {
  // `proxy` is the tool's origin.
  HapticOutput haptic;
  ToolStep tool;
  Vec3 torque_D_n_mm = Vec3::Zero();  // about the HIP; not limited yet
};

// `state`: of the stylus and the device; it has no point meanwhile. `memory`: a new one takes the
// tool up where the stylus is. `work`: as in tool_step.h; where the surface has moved, half of it
// is for that.
ToolOutput StepWithTool(const FeltTool& felt, const HapticSettings& settings, const Vec3& p_DHip_mm,
                        const Eigen::Quaterniond& R_DS, double dt_s, int work, RendererState& state,
                        ToolMemory& memory) noexcept;

// As TellWrittenForce, after a step with a tool.
void TellWrittenWrench(const Wrench& written_D, double rotation_length_mm, RendererState& state,
                       ToolMemory& memory) noexcept;

}  // namespace palpate
