// A picture on the graphics card: colours, and depth where it has one.
//
// The first row is the bottom, as OpenGL has it.
// Threads: that of the current OpenGL 4.3 context. Errors: Error with kTooLarge for a
// size that the context has no pictures of, or that its memory does not hold.
#pragma once

#include <cstdint>
#include <vector>

#include "client/view/scene/camera.h"

namespace palpate::view {

// Of the framebuffer that is bound: four bytes a pixel, the first row the top.
std::vector<std::uint8_t> ReadRows(const ImageSize& size);

// Throws where the context has no pictures of that size.
void RequirePictureSize(const ImageSize& size);

class FrameTarget {
 public:
  enum class Depth { kNone, kFloat };

  FrameTarget() = default;  // without depth
  explicit FrameTarget(Depth depth) : has_depth_(depth == Depth::kFloat) {}
  ~FrameTarget();
  FrameTarget(const FrameTarget&) = delete;
  FrameTarget& operator=(const FrameTarget&) = delete;

  // True where it changed; then its contents are undefined. Where the size is refused it
  // stays as it was, and where the memory does not hold it, it is empty.
  bool Resize(const ImageSize& size);
  const ImageSize& size() const { return size_; }
  bool empty() const { return framebuffer_ == 0; }

  // GL names; 0 where it is empty.
  unsigned framebuffer() const { return framebuffer_; }
  unsigned color() const { return color_; }  // RGBA8
  unsigned depth() const { return depth_; }  // DEPTH_COMPONENT32F

  // Binds it, with the whole of it as the viewport.
  void Bind() const;
  // Colours and depths of another of its size.
  void CopyFrom(const FrameTarget& other);
  // Four bytes a pixel; the first row is the top.
  std::vector<std::uint8_t> ReadColors() const;

 private:
  void Release();

  bool has_depth_ = false;
  ImageSize size_;
  unsigned framebuffer_ = 0;
  unsigned color_ = 0;
  unsigned depth_ = 0;
};

}  // namespace palpate::view
