#include "server/lab/mesh_files.h"

#include <algorithm>
#include <bit>
#include <cctype>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <string>
#include <string_view>

#include "common/error/error.h"
#include "common/files/new_file.h"

namespace palpate::lab {
namespace {

static_assert(std::endian::native == std::endian::little);

using Triangle = std::array<std::uint32_t, 3>;

std::string Ending(const std::filesystem::path& path) {
  std::string ending = path.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return ending;
}

// Collects the output, so that many triangles need only one call of the stream.
class Buffer {
 public:
  explicit Buffer(std::ofstream& out) : out_(out) { text_.reserve(kSize + 1024); }

  Buffer& Text(std::string_view text) {
    text_ += text;
    return *this;
  }
  template <class Number>
  Buffer& Decimal(Number number) {  // the shortest text that reads back as the same number
    char digits[32];
    const auto end = std::to_chars(digits, digits + sizeof digits, number).ptr;
    return Text({digits, static_cast<std::size_t>(end - digits)});
  }
  template <class Value>
  Buffer& Bytes(const Value& value) {
    char bytes[sizeof value];
    std::memcpy(bytes, &value, sizeof value);
    return Text({bytes, sizeof bytes});
  }

  void FlushIfFull() {
    if (text_.size() >= kSize) Flush();
  }
  void Flush() {
    out_.write(text_.data(), static_cast<std::streamsize>(text_.size()));
    text_.clear();
  }

 private:
  static constexpr std::size_t kSize = 1 << 20;
  std::ofstream& out_;
  std::string text_;
};

void WritePly(const SurfaceMesh& mesh, const AffineMap& X_WI, bool mirrored, Buffer& out) {
  out.Text("ply\nformat binary_little_endian 1.0\ncomment palpate-lab: world mm, LPS\n");
  out.Text("element vertex ").Decimal(mesh.vertices.size());
  out.Text("\nproperty double x\nproperty double y\nproperty double z\n");
  out.Text("element face ").Decimal(mesh.triangles.size());
  out.Text("\nproperty list uchar int vertex_indices\nend_header\n");
  for (const Vec3& p_I : mesh.vertices) {
    const Vec3 p_W = X_WI.Apply(p_I);
    for (int axis = 0; axis < 3; ++axis) out.Bytes(p_W[axis]);
    out.FlushIfFull();
  }
  for (const Triangle& t : mesh.triangles) {
    out.Bytes(std::uint8_t{3}).Bytes(t[0]).Bytes(t[mirrored ? 2 : 1]).Bytes(t[mirrored ? 1 : 2]);
    out.FlushIfFull();
  }
}

void WriteObj(const SurfaceMesh& mesh, const AffineMap& X_WI, bool mirrored, Buffer& out) {
  out.Text("# palpate-lab: world mm, LPS\n");
  for (const Vec3& p_I : mesh.vertices) {
    const Vec3 p_W = X_WI.Apply(p_I);
    out.Text("v");
    for (int axis = 0; axis < 3; ++axis) out.Text(" ").Decimal(p_W[axis]);
    out.Text("\n").FlushIfFull();
  }
  for (const Triangle& t : mesh.triangles) {
    out.Text("f ").Decimal(t[0] + 1).Text(" ").Decimal(t[mirrored ? 2 : 1] + 1);
    out.Text(" ").Decimal(t[mirrored ? 1 : 2] + 1).Text("\n").FlushIfFull();
  }
}

void WriteTo(const std::filesystem::path& path, const std::string& ending, const SurfaceMesh& mesh,
             const AffineMap& X_WI) {
  std::ofstream out;
  out.exceptions(std::ios::failbit | std::ios::badbit);
  out.open(path, std::ios::binary | std::ios::trunc);
  Buffer buffer(out);
  const bool mirrored = X_WI.linear.determinant() < 0.0;
  (ending == ".ply" ? WritePly : WriteObj)(mesh, X_WI, mirrored, buffer);
  buffer.Flush();
  out.close();
}

}  // namespace

void CheckMeshFileName(const std::filesystem::path& path) {
  const std::string ending = Ending(path);
  if (ending == ".ply" || ending == ".obj") return;
  throw Error(ErrorKind::kInvalidArgument,
              path.string() + ": the name of a mesh must end in .ply or .obj");
}

void WriteMesh(const SurfaceMesh& mesh, const AffineMap& X_WI, const std::filesystem::path& path,
               IfThere if_there) {
  CheckMeshFileName(path);
  const auto write = [&](const std::filesystem::path& partial) {
    WriteTo(partial, Ending(path), mesh, X_WI);
  };
  WriteWhole(path, write, if_there);
}

}  // namespace palpate::lab
