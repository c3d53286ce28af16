#include "server/lab/gbid.h"

namespace palpate::lab {
namespace {

// Finds the crossing on the segment from free space to inside the object.
Vec3 FindCrossing(const VolumeSnapshot& volume, double isovalue, Vec3 free, Vec3 inside) {
  constexpr int kHalvings = 50;
  for (int n = 0; n < kHalvings; ++n) {
    const Vec3 middle = 0.5 * (free + inside);
    (SampleField(volume, middle).value > isovalue ? inside : free) = middle;
  }
  return free;
}

}  // namespace

FieldSample SampleField(const VolumeSnapshot& volume, const Vec3& p_I) {
  const Vec3i cell = p_I.array().floor().cast<int>();
  const Trilinear f(volume.StoredCell(cell));
  const Vec3 local = p_I - cell.cast<double>();
  return {f.Value(local), f.Gradient(local)};
}

void StepGbid(const VolumeSnapshot& volume, double isovalue, const Vec3& p_IHip, double correction,
              Gbid& proxy) {
  if (!proxy.in_contact) {
    if (!(SampleField(volume, p_IHip).value > isovalue)) {
      proxy.p_I = p_IHip;
      return;
    }
    proxy.p_I = FindCrossing(volume, isovalue, proxy.p_I, p_IHip);
    proxy.in_contact = true;
  }
  const FieldSample sample = SampleField(volume, proxy.p_I);
  const double steepness = sample.gradient.norm();
  if (!(steepness > 0.0)) return;
  const Vec3 normal = -sample.gradient / steepness;  // towards free space
  const Vec3 on_plane = proxy.p_I + correction * (sample.value - isovalue) / steepness * normal;
  const double height = (p_IHip - on_plane).dot(normal);
  if (height > 0.0) {  // above the plane: contact ends
    proxy.p_I = p_IHip;
    proxy.in_contact = false;
    return;
  }
  proxy.p_I = p_IHip - height * normal;
}

}  // namespace palpate::lab
