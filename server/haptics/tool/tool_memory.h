// What a haptic update with a tool remembers for the next one. server/servo/servo_memory.h lists
// it member by member.
//
// Threads: plain values.
#pragma once

#include <cstdint>

#include "common/contract/enumerations.h"
#include "server/haptics/passivity.h"
#include "server/haptics/tool/spring_tank.h"
#include "server/haptics/tool/tool_step.h"

namespace palpate {

// The surfaces of a step, and the spring, as far as they tell whether they are the next one's.
struct ToolSurfacesFelt {
  std::uint64_t geometry_revision = 0;
  std::uint64_t volume_revision = 0;
  int refinement = 1;
  FreeSide free_side = FreeSide::kBelow;
  double isovalue = 0.0;
  double stiffness_n_per_mm = 0.0;

  bool operator==(const ToolSurfacesFelt&) const = default;
};

struct ToolMemory {
  ToolState state;
  ToolSurfacesFelt felt;
  bool is_settling = false;  // to what has changed under it
  bool touches = false;
  double slope_per_mm = 0.0;  // the least of the density where the tool touches
  UnalignedQuaternion R_DS = UnalignedQuaternion::Identity();  // of the last stylus
  // The sum of ρ times the stylus's turns since the tool is there, each with the ρ of its tool.
  Vec3 turned_mm = Vec3::Zero();
  double spring_mj = 0.0;  // of force and torque, in the last step
  SpringTank tank;
  PassivityStateOf<6> passivity;  // of a device with torque
};

}  // namespace palpate
