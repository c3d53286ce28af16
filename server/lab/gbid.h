// A gradient-based implicit proxy (GBID), for comparison with ours.
//
// A GBID knows the surface only by the value and gradient of F at one point, as in haptic rendering
// of implicit surfaces (Salisbury and Tarr 1997; Corenthy et al., Fig. 9). In contact, it replaces
// the surface by the plane through the proxy, normal to the gradient there. The proxy goes to the
// HIP's projection on this plane. The plane is a tangent, so on a curved surface every step leaves
// the isovalue a little, always to the same side.
// `correction` reduces this error: the plane is shifted along the normal by this share of (F - τ) /
// |∇F|. With 0 the error adds up. With 1 the error stays as large as one step makes it.
//
// Frame: index coordinates. Threads: pure; one thread per proxy.
#pragma once

#include "server/volume/snapshot/snapshot.h"

namespace palpate::lab {

// Samples V: the densities as stored, without resolved ties.
struct FieldSample {
  double value;
  Vec3 gradient;  // per voxel
};
FieldSample SampleField(const VolumeSnapshot& volume, const Vec3& p_I);

struct Gbid {
  Vec3 p_I = Vec3::Zero();
  bool in_contact = false;
};

// Makes one step towards the HIP. `isovalue`: normalised. At the first step, HIP and proxy must be
// in free space.
void StepGbid(const VolumeSnapshot& volume, double isovalue, const Vec3& p_IHip, double correction,
              Gbid& proxy);

}  // namespace palpate::lab
