// A rigid tool in the view: as it is felt, where the hand wants it, which balls hold it back, and
// the torque on the hand.
//
// Frame: D (mm). Threads: pure.
#pragma once

#include "client/view/drawing/camera.h"
#include "client/view/drawing/overlay.h"
#include "common/contract/render.h"

namespace palpate::view {

// The tool as it is felt is solid, its touching balls in the proxy's colour. Where the hand wants
// it, outlines show it, unless it is there.
void AddTool(const client::Pose& pose, const HeldTool& tool, const Projection& projection,
             Overlay& overlay);

// An arc about the torque's axis around SCP_H; at the greatest torque three quarters of a circle.
void AddTorque(const client::Pose& pose, double max_torque_n_mm, const Projection& projection,
               Overlay& overlay);

}  // namespace palpate::view
