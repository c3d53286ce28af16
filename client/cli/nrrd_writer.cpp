#include "client/cli/nrrd_writer.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <vector>

#include "common/error/error.h"

namespace palpate::cli {
namespace {

[[noreturn]] void ThrowErrno(const std::string& path, int error_number) {
  const ErrorKind kind = error_number == ENOENT || error_number == ENOTDIR ? ErrorKind::kNotFound
                         : error_number == EACCES || error_number == EPERM || error_number == EROFS
                             ? ErrorKind::kPermissionDenied
                         : error_number == ENOSPC || error_number == EDQUOT || error_number == EFBIG
                             ? ErrorKind::kUnavailable
                             : ErrorKind::kInternal;
  throw Error(kind, "cannot write " + path + ": " + std::strerror(error_number));
}

// A file beside `path` that is removed unless it is moved there.
class FileBeside {
 public:
  explicit FileBeside(const std::string& path)
      : path_(path), beside_(fmt::format("{}.part-{}", path, getpid())) {
    file_ = open(beside_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (file_ < 0) ThrowErrno(path_, errno);
  }
  ~FileBeside() {
    if (file_ >= 0) close(file_);
    if (!moved_) unlink(beside_.c_str());
  }
  FileBeside(const FileBeside&) = delete;
  FileBeside& operator=(const FileBeside&) = delete;

  void Write(std::string_view bytes) {
    while (!bytes.empty()) {
      const ssize_t written = write(file_, bytes.data(), bytes.size());
      if (written < 0 && errno == EINTR) continue;
      if (written < 0) ThrowErrno(path_, errno);
      bytes.remove_prefix(static_cast<std::size_t>(written));
    }
  }

  void Move() {
    const int closed = close(file_);
    file_ = -1;
    if (closed != 0 || std::rename(beside_.c_str(), path_.c_str()) != 0) ThrowErrno(path_, errno);
    moved_ = true;
  }

 private:
  std::string path_;
  std::string beside_;
  int file_ = -1;
  bool moved_ = false;
};

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
  if (access(file.parent_path().c_str(), W_OK) != 0) ThrowErrno(path, errno);
}

void WriteNrrd(const VolumeMirror& mirror, const std::string& path, bool overwrite,
               const std::function<void()>& check) {
  CheckNrrdPath(path, overwrite);
  FileBeside file(path);
  file.Write(Header(*mirror.lattice()));
  std::vector<float> voxels;
  for (int k = 0; k < mirror.lattice()->size.z(); k += kBrickEdge) {
    check();
    FillSlices(mirror, k, voxels);
    file.Write({reinterpret_cast<const char*>(voxels.data()), voxels.size() * sizeof(float)});
  }
  file.Move();
}

}  // namespace palpate::cli
