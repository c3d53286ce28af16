#include "client/cli/nrrd_writer.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <vector>

#include "common/error/error.h"
#include "common/files/new_file.h"

namespace palpate::cli {
namespace {

std::string VectorText(const Vec3& v) { return fmt::format("({},{},{})", v.x(), v.y(), v.z()); }

std::string Header(const VolumeLattice& lattice) {
  const Mat3& linear = lattice.X_WI.linear;
  return fmt::format(
      "NRRD0004\n"
      "type: float\n"
      "dimension: 3\n"
      "space: left-posterior-superior\n"
      "sizes: {} {} {}\n"
      "space directions: {} {} {}\n"
      "kinds: domain domain domain\n"
      "endian: little\n"
      "encoding: raw\n"
      "space origin: {}\n"
      "\n",
      lattice.size.x(), lattice.size.y(), lattice.size.z(), VectorText(linear.col(0)),
      VectorText(linear.col(1)), VectorText(linear.col(2)), VectorText(lattice.X_WI.translation));
}

// Slices k .. k + 7 at most, x fastest: the layer of bricks that holds them.
void FillSlices(const VolumeMirror& mirror, int k, std::vector<float>& voxels) {
  const Vec3i& size = mirror.lattice()->size;
  const int end = std::min(k + kBrickEdge, size.z());
  voxels.clear();
  for (; k < end; ++k) {
    for (int j = 0; j < size.y(); ++j) {
      for (int i = 0; i < size.x(); ++i) voxels.push_back(mirror.Value(i, j, k));
    }
  }
}

}  // namespace

void CheckNrrdPath(const std::string& path, bool overwrite) {
  const std::filesystem::path file = std::filesystem::absolute(path);
  std::error_code ignored;
  if (std::filesystem::is_directory(file, ignored)) {
    throw Error(ErrorKind::kInvalidArgument, path + " is a folder: name a file");
  }
  if (!std::filesystem::is_directory(file.parent_path(), ignored)) {
    throw Error(ErrorKind::kNotFound, "there is no folder " + file.parent_path().string());
  }
  if (!overwrite && std::filesystem::exists(file, ignored)) {
    throw Error(ErrorKind::kConflict, path + " is there: name another file, or give --overwrite");
  }
  if (access(file.parent_path().c_str(), W_OK) != 0) throw CannotWrite(path, errno);
}

void WriteNrrd(const VolumeMirror& mirror, const std::string& path, bool overwrite,
               const std::function<void()>& check) {
  CheckNrrdPath(path, overwrite);
  NewFile file(path, overwrite ? IfThere::kReplace : IfThere::kRefuse);
  file.Write(Header(*mirror.lattice()));
  std::vector<float> voxels;
  for (int k = 0; k < mirror.lattice()->size.z(); k += kBrickEdge) {
    check();
    FillSlices(mirror, k, voxels);
    file.Write({reinterpret_cast<const char*>(voxels.data()), voxels.size() * sizeof(float)});
  }
  file.TakeName();
}

}  // namespace palpate::cli
