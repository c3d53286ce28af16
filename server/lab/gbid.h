// A gradient-based implicit proxy (GBID), to compare ours with.
//
// The surface is known by value and gradient of F at one point alone, as in
// haptic rendering of implicit surfaces (Salisbury and Tarr 1997; Corenthy et al.,
// Fig. 9). In contact it is taken for the plane through the proxy, normal to the
// gradient there, and the proxy goes to the HIP's projection on that plane. The
// plane is a tangent, so that on a curved surface every step leaves the isovalue a
// little, always to the same side. `correction` brings the value in: the plane is
// shifted along the normal by that share of (F - τ) / |∇F|. With 0 the error adds
// up; with 1 it stays, as large as one step makes it.
//
// Frame: index coordinates. Threads: pure; one thread per proxy.
#pragma once

#include "server/volume/snapshot.h"

namespace palpate::lab {

// Of V: of the densities as stored, without resolved ties.
struct FieldSample {
  double value;
  Vec3 gradient;  // per voxel
};
FieldSample SampleField(const VolumeSnapshot& volume, const Vec3& p_I);

struct Gbid {
  Vec3 p_I = Vec3::Zero();
  bool in_contact = false;
};

// One step towards the HIP. `isovalue` normalised. Starts where HIP and proxy are
// in free space.
void StepGbid(const VolumeSnapshot& volume, double isovalue, const Vec3& p_IHip, double correction,
              Gbid& proxy);

}  // namespace palpate::lab
