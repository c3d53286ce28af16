// A picture on the graphics card: colours, and optionally depth.
//
// The bottom row is first, as in OpenGL.
// Threads: that of the current OpenGL 4.3 context. Errors: kTooLarge for a size that the context
// does not support, or that its memory does not hold.
#pragma once

#include <cstdint>
#include <vector>

#include "client/view/drawing/camera.h"

namespace palpate::view {

// Reads the bound framebuffer: four bytes a pixel, the top row first.
std::vector<std::uint8_t> ReadRows(const ImageSize& size);

// Throws kTooLarge if the context does not support pictures of this size.
void RequirePictureSize(const ImageSize& size);

class FrameTarget {
 public:
  enum class Depth { kNone, kFloat };

  FrameTarget() = default;  // without depth
  explicit FrameTarget(Depth depth) : has_depth_(depth == Depth::kFloat) {}
  ~FrameTarget();
  FrameTarget(const FrameTarget&) = delete;
  FrameTarget& operator=(const FrameTarget&) = delete;

  // Returns true if the size changed; the contents are then undefined. If the context does not
  // support the size, the picture is unchanged. If the memory does not hold it, the picture is
  // empty.
  bool Resize(const ImageSize& size);
  const ImageSize& size() const { return size_; }
  bool empty() const { return framebuffer_ == 0; }

  // OpenGL names; 0 if the picture is empty.
  unsigned framebuffer() const { return framebuffer_; }
  unsigned color() const { return color_; }  // RGBA8
  unsigned depth() const { return depth_; }  // DEPTH_COMPONENT32F

  // Binds the picture, with all of it as the viewport.
  void Bind() const;
  // Copies colours and depths of another picture of the same size.
  void CopyFrom(const FrameTarget& other);
  // Four bytes a pixel; the top row is first.
  std::vector<std::uint8_t> ReadColors() const;
  // All depths or one, 0 to 1 as clip_from_D gives them; the bottom row is first. The picture must
  // have depth.
  std::vector<float> ReadDepths() const;
  float ReadDepth(int x_px, int y_from_bottom_px) const;

 private:
  void Release();

  bool has_depth_ = false;
  ImageSize size_;
  unsigned framebuffer_ = 0;
  unsigned color_ = 0;
  unsigned depth_ = 0;
};

}  // namespace palpate::view
