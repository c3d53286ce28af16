// Shader programs on the graphics card, and those that read a volume.
//
// Threads: that of the current OpenGL 4.3 context. Errors: kInternal if the driver refuses a
// shader; the text is the driver's.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>

#include "client/view/drawing/value_window.h"
#include "client/view/render/brick_cache.h"
#include "common/geometry/geometry.h"

namespace palpate::view {

class ShaderProgram {
 public:
  // From a fragment shader. The vertices are those of one triangle that covers the viewport. The
  // fragment shader gets only gl_FragCoord.
  explicit ShaderProgram(const std::string& fragment_source);
  // From both shaders. The caller draws the vertices.
  ShaderProgram(const std::string& vertex_source, const std::string& fragment_source);
  ~ShaderProgram();
  ShaderProgram(const ShaderProgram&) = delete;
  ShaderProgram& operator=(const ShaderProgram&) = delete;

  void Use() const;
  // Sets a uniform of the program in use. Ignores names that the driver has removed as unused.
  void Set(const char* name, int value) const;
  void Set(const char* name, double value) const;
  void Set(const char* name, const Vec3i& value) const;
  // A vector of two to four numbers, or a square matrix of three or four rows.
  template <class Derived>
  requires std::is_floating_point_v<typename Derived::Scalar>
  void Set(const char* name, const Eigen::MatrixBase<Derived>& value) const {
    constexpr int kRows = Derived::RowsAtCompileTime, kColumns = Derived::ColsAtCompileTime;
    constexpr bool kIsVector = kRows == 1 || kColumns == 1;
    static_assert(kIsVector ? kRows * kColumns >= 2 && kRows * kColumns <= 4
                            : kRows == kColumns && (kRows == 3 || kRows == 4));
    // Not auto: a transposed matrix would stay in the order of rows.
    const Eigen::Matrix<float, kRows, kColumns> floats = value.template cast<float>();
    SetFloats(name, floats.data(), static_cast<int>(floats.size()));
  }
  // Draws the triangle that covers the viewport.
  void Draw() const;

 private:
  void SetFloats(const char* name, const float* floats, int count) const;

  unsigned program_ = 0;
  unsigned no_vertices_ = 0;  // a core context needs a vertex array, even an empty one
};

// The shader storage buffer of the marks: 0. Further buffers begin here.
inline constexpr unsigned kFirstFreeBuffer = 1;

// The programs that read a volume from the tables of a brick cache, for each type of its values,
// and show values in a colour map. Their frame is P of shading.h.
//
// Threads: those of BrickCache. Errors: those of ShaderProgram.
class VolumePrograms {
 public:
  // `fragment_source` comes after kVolumeDesktop and kCell of shading.h. Its colours are in
  // `color_map`, as ColorAt of kColors reads them. Texture units 0 to 4 are taken.
  explicit VolumePrograms(std::string fragment_source);
  ~VolumePrograms();
  VolumePrograms(const VolumePrograms&) = delete;
  VolumePrograms& operator=(const VolumePrograms&) = delete;

  // Makes the program for this volume the one in use, and binds the volume and the map to it.
  const ShaderProgram& Use(const BrickCache& volume, ColorMap map);

 private:
  std::string fragment_source_;
  std::array<std::unique_ptr<ShaderProgram>, 4> programs_;  // by LeafType
  unsigned colors_;                                         // a texture
  std::optional<ColorMap> shown_;                           // in colors_
};

}  // namespace palpate::view
