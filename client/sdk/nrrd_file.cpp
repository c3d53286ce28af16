#include "client/sdk/nrrd_file.h"

#include <algorithm>
#include <vector>

#include "common/error/error.h"
#include "common/files/new_file.h"
#include "common/files/nrrd_header.h"

namespace palpate::client {
namespace {

// Fills the slices k to k + 7 at most, x fastest: one layer of bricks.
void FillSlices(const VolumeMirror& volume, int k, std::vector<float>& voxels) {
  const Vec3i& size = volume.lattice()->size;
  const int end = std::min(k + kBrickEdge, size.z());
  voxels.clear();
  for (; k < end; ++k) {
    for (int j = 0; j < size.y(); ++j) {
      for (int i = 0; i < size.x(); ++i) voxels.push_back(volume.Value(i, j, k));
    }
  }
}

}  // namespace

void CheckNrrdPath(const std::string& path, bool overwrite) {
  CheckNewFile(path, ReplacesIf(overwrite));
}

void SaveAsNrrd(const VolumeMirror& volume, const std::string& path, bool overwrite,
                const std::function<void()>& check) {
  CheckNrrdPath(path, overwrite);
  NewFile file(path, ReplacesIf(overwrite));
  const VolumeLattice& lattice = *volume.lattice();
  file.Write(ToText(
      NrrdHeader{.type = "float", .encoding = "raw", .size = lattice.size, .X_WI = lattice.X_WI}));
  std::vector<float> voxels;
  for (int k = 0; k < lattice.size.z(); k += kBrickEdge) {
    if (check) check();
    FillSlices(volume, k, voxels);
    file.Write({reinterpret_cast<const char*>(voxels.data()), voxels.size() * sizeof(float)});
  }
  file.TakeName();
}

}  // namespace palpate::client
