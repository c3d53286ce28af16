// One haptic update: stylus position in, proxies and force out.
//
//   HIP -> proxy (with friction) -> spring -> shading -> damper and viscosity
//       -> passivity control -> magnet, fading force of a pop -> force
//
// Penetrability: where the spring exceeds pop_force_n the proxy changes to the
// other side of H, and moves on towards the HIP until it meets H again, now from
// within. Every passage through H costs that force, inwards as outwards, as through
// a membrane. The force of the moment fades out over kPopFadeS.
//
// Frame: D (mm, N). Threads: pure; one thread per state.
// Real-time: no allocation, no locks; bounded by the bounds of the proxy.
#pragma once

#include "server/haptics/friction.h"
#include "server/haptics/haptic_surface.h"
#include "server/haptics/passivity.h"
#include "server/haptics/proxy.h"
#include "server/haptics/settings.h"
#include "server/haptics/visual_proxy.h"

namespace palpate {

// A surface that would need more than this force to be felt is not pulled to
// when the proxy is brought out of the object.
inline constexpr double kEjectForceLimitN = 3.3;

inline constexpr double kPopFadeS = 0.03;

// What the next step depends on besides its input; server/servo/servo_memory.h
// lists it member by member.
struct RendererMemory {
  Proxy proxy;
  bool has_hip = false;
  Vec3 p_DHip_mm = Vec3::Zero();          // last accepted
  Vec3 p_DLastHip_mm = Vec3::Zero();      // of the last step
  Vec3 velocity_mm_per_s = Vec3::Zero();  // of the HIP, low-passed
  FrictionState friction;
  bool popped = false;                // on the other side than the settings'
  double rejected_s = 0.0;            // since the last accepted HIP
  double spring_mj = 0.0;             // that the spring held in the last step
  Vec3 felt_D_n = Vec3::Zero();       // last force without the magnet
  Vec3 pop_force_D_n = Vec3::Zero();  // what the last pop took away
  double pop_fade = 0.0;              // share of it that is left
  PassivityState passivity;
  Vec3 limited_D_n = Vec3::Zero();    // of the last force: what the control let pass
  Vec3 by_design_D_n = Vec3::Zero();  // the rest of it: magnet and pop
};

struct RendererState : RendererMemory {
  PassivityDevice device;  // the same for all steps
  CellCache cache;
};

struct HapticOutput {
  Vec3 p_DHip_mm = Vec3::Zero();  // the HIP used: the last good one where the input was not finite
  ProxyStep proxy;
  VisualProxy visual;
  Vec3 spring_D_n = Vec3::Zero();         // k (SCP_H - HIP)
  Vec3 force_D_n = Vec3::Zero();          // with damping and effects; not limited yet
  FreeSide free_side = FreeSide::kBelow;  // of the proxy
  bool popped = false;                    // in this step
  bool input_rejected = false;
};

HapticOutput StepRenderer(const HapticSurface& surface, const HapticSettings& settings,
                          const Vec3& p_DHip_mm, double dt_s, RendererState& state) noexcept;

// A step in which nothing is felt: the proxy is where the HIP is. The next
// StepRenderer begins anew there.
HapticOutput SuspendRenderer(const Vec3& p_DHip_mm, double dt_s, RendererState& state) noexcept;

// After each step, where the force is limited further before it is written: the
// passivity control accounts for what the hand gets.
void TellWrittenForce(const Vec3& written_D_n, RendererState& state) noexcept;

}  // namespace palpate
