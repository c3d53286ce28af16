// A shader program on the graphics card.
//
// Threads: that of the current OpenGL 4.3 context. Errors: kInternal if the driver refuses a
// shader; the text is the driver's.
#pragma once

#include <string>
#include <type_traits>

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

}  // namespace palpate::view
