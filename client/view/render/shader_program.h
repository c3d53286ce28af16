// A program of shaders on the graphics card.
//
// Threads: that of the current OpenGL 4.3 context. Errors: Error with kInternal where
// the driver refuses a shader, with what it says.
#pragma once

#include <string>

#include "common/geometry/geometry.h"

namespace palpate::view {

class ShaderProgram {
 public:
  // The source of a fragment shader. The vertices are those of one triangle that covers
  // the viewport; it hands over nothing but gl_FragCoord.
  explicit ShaderProgram(const std::string& fragment_source);
  // With vertices of the caller's, who draws them.
  ShaderProgram(const std::string& vertex_source, const std::string& fragment_source);
  ~ShaderProgram();
  ShaderProgram(const ShaderProgram&) = delete;
  ShaderProgram& operator=(const ShaderProgram&) = delete;

  void Use() const;
  // Of the program in use. Names that the driver has dropped as unused are ignored.
  void Set(const char* name, int value) const;
  void Set(const char* name, double value) const;
  void Set(const char* name, const Vec3i& value) const;
  void Set(const char* name, const Vec3& value) const;
  void Set(const char* name, const Eigen::Vector4d& value) const;
  void Set(const char* name, const Mat3& value) const;
  void Set(const char* name, const Eigen::Matrix4d& value) const;
  void Set(const char* name, const Eigen::Vector2d& value) const;
  // The triangle that covers the viewport.
  void Draw() const;

 private:
  unsigned program_ = 0;
  unsigned no_vertices_ = 0;  // a core context wants a vertex array, even if empty
};

}  // namespace palpate::view
