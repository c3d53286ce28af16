#include "client/view/render/frame_target.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <string>

#include "client/view/render/gl_state.h"
#include "common/error/error.h"

namespace palpate::view {
namespace {

std::string SizeText(const ImageSize& size) {
  return std::to_string(size.width) + " x " + std::to_string(size.height);
}

}  // namespace

void RequirePictureSize(const ImageSize& size) {
  GLint most = 0;
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &most);
  GLint viewport[2] = {};
  glGetIntegerv(GL_MAX_VIEWPORT_DIMS, viewport);
  if (size.width <= std::min(most, viewport[0]) && size.height <= std::min(most, viewport[1])) {
    return;
  }
  throw Error(ErrorKind::kTooLarge,
              "pictures on this graphics card have at most " +
                  SizeText({std::min(most, viewport[0]), std::min(most, viewport[1])}) +
                  " pixels, not " + SizeText(size));
}

FrameTarget::~FrameTarget() { Release(); }

void FrameTarget::Release() {
  glDeleteFramebuffers(1, &framebuffer_);
  glDeleteTextures(1, &color_);
  glDeleteTextures(1, &depth_);
  framebuffer_ = color_ = depth_ = 0;
  size_ = {};
}

bool FrameTarget::Resize(const ImageSize& size) {
  if (size == size_) return false;
  RequirePictureSize(size);
  Release();
  size_ = size;
  if (size.width <= 0 || size.height <= 0) return true;
  TakeErrors();
  glGenFramebuffers(1, &framebuffer_);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
  color_ = NewTexture(GL_RGBA8, size);
  glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, color_, 0);
  if (has_depth_) {
    depth_ = NewTexture(GL_DEPTH_COMPONENT32F, size);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, depth_, 0);
  }
  if (!TakeErrors()) return true;
  Release();
  throw Error(ErrorKind::kTooLarge, "the graphics card has no memory left for a picture of " +
                                        SizeText(size) + " pixels");
}

void FrameTarget::Bind() const {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
  glViewport(0, 0, size_.width, size_.height);
}

void FrameTarget::CopyFrom(const FrameTarget& other) {
  const auto copy = [this](GLuint from, GLuint to) {
    glCopyImageSubData(from, GL_TEXTURE_2D, 0, 0, 0, 0, to, GL_TEXTURE_2D, 0, 0, 0, 0, size_.width,
                       size_.height, 1);
  };
  copy(other.color_, color_);
  copy(other.depth_, depth_);
}

std::vector<std::uint8_t> FrameTarget::ReadColors() const {
  if (empty()) return {};
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
  return ReadRows(size_);
}

std::vector<float> FrameTarget::ReadDepths() const {
  if (empty()) return {};
  std::vector<float> depths(static_cast<std::size_t>(size_.width) * size_.height);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
  glReadPixels(0, 0, size_.width, size_.height, GL_DEPTH_COMPONENT, GL_FLOAT, depths.data());
  return depths;
}

float FrameTarget::ReadDepth(int x_px, int y_from_bottom_px) const {
  float depth = 1.0f;
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_);
  glReadPixels(x_px, y_from_bottom_px, 1, 1, GL_DEPTH_COMPONENT, GL_FLOAT, &depth);
  return depth;
}

std::vector<std::uint8_t> ReadRows(const ImageSize& size) {
  const std::size_t row = 4 * static_cast<std::size_t>(size.width);
  std::vector<std::uint8_t> rgba(row * size.height);
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glReadPixels(0, 0, size.width, size.height, GL_RGBA, GL_UNSIGNED_BYTE, rgba.data());
  for (int y = 0; y < size.height / 2; ++y) {
    const auto top = rgba.begin() + static_cast<std::ptrdiff_t>(y * row);
    std::swap_ranges(top, top + static_cast<std::ptrdiff_t>(row),
                     rgba.end() - static_cast<std::ptrdiff_t>((y + 1) * row));
  }
  return rgba;
}

}  // namespace palpate::view
