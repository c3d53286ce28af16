#include "client/view/render/volume_texture.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <iterator>
#include <string>

#include "common/error/error.h"

namespace palpate::view {
namespace {

std::string SizeText(const Vec3i& size) {
  return std::to_string(size.x()) + " x " + std::to_string(size.y()) + " x " +
         std::to_string(size.z()) + " voxels";
}

// Throws if the lattice with its outer layer exceeds the context's textures.
void RequireSize(const Vec3i& size) {
  GLint most = 0;
  glGetIntegerv(GL_MAX_3D_TEXTURE_SIZE, &most);
  if (size.maxCoeff() + 2 <= most) return;
  throw Error(ErrorKind::kTooLarge, "the volume of " + SizeText(size) +
                                        " is too large for this graphics card, which " +
                                        "shows at most " + std::to_string(most - 2) +
                                        " along each axis: load a resampled or cropped volume");
}

// Axes are those of the lattice in reverse, as in the memory of a brick.
unsigned NewTexture(GLenum format, const Vec3i& size) {
  GLuint texture = 0;
  glGenTextures(1, &texture);
  glBindTexture(GL_TEXTURE_3D, texture);
  glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTexParameteri(GL_TEXTURE_3D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  while (glGetError() != GL_NO_ERROR) {
    // Clear old errors: they must not be taken for errors of this texture.
  }
  glTexStorage3D(GL_TEXTURE_3D, 1, format, size.z(), size.y(), size.x());
  if (glGetError() == GL_NO_ERROR) return texture;
  glDeleteTextures(1, &texture);
  return 0;
}

// glClearTexImage would need OpenGL 4.4. A layered framebuffer does the same.
void Fill(GLuint texture, float value) {
  GLint bound = 0;
  glGetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &bound);
  GLuint framebuffer = 0;
  glGenFramebuffers(1, &framebuffer);
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
  glFramebufferTexture(GL_DRAW_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, texture, 0);
  const GLfloat color[] = {value, value, value, value};
  glClearBufferfv(GL_COLOR, 0, color);
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, static_cast<GLuint>(bound));
  glDeleteFramebuffers(1, &framebuffer);
}

Vec3i BrickCounts(const Vec3i& size) {
  return {BrickCount(size.x()), BrickCount(size.y()), BrickCount(size.z())};
}

}  // namespace

VolumeTexture::~VolumeTexture() { Release(); }

void VolumeTexture::Release() {
  if (voxels_ != 0) glDeleteTextures(1, &voxels_);
  if (ranges_ != 0) glDeleteTextures(1, &ranges_);
  voxels_ = 0;
  ranges_ = 0;
  waiting_.clear();
}

bool VolumeTexture::TakeUp(ViewVolume& volume, std::size_t most_bricks) {
  TakeUpPlacement(volume);
  const VolumeChanges changes = volume.TakeChanges();
  if (changes.all) Begin(volume);
  if (voxels_ == 0) return true;

  Await(changes.bricks);
  for (std::size_t n = 0; n < most_bricks && !waiting_.empty(); ++n) {
    const std::uint64_t number = waiting_.front();
    waiting_.pop_front();
    is_waiting_[number] = false;
    UploadBrick(volume.At(number), number);
    WidenRangesAt(number, volume);
  }
  UploadRanges();
  return waiting_.empty();
}

void VolumeTexture::Await(std::span<const std::uint64_t> bricks) {
  for (const std::uint64_t number : bricks) {
    if (is_waiting_[number]) continue;
    is_waiting_[number] = true;
    waiting_.push_back(number);
  }
}

void VolumeTexture::TakeUpPlacement(const ViewVolume& volume) {
  if (X_DI_ == volume.X_DI()) return;
  X_DI_ = volume.X_DI();
  ++version_;
}

void VolumeTexture::Begin(const ViewVolume& volume) {
  Release();
  ++version_;
  if (!volume.lattice()) return;

  const VolumeLattice& lattice = *volume.lattice();
  size_ = lattice.size;
  cell_brick_count_ = volume.cell_brick_count();
  value_min_ = lattice.value_min;
  value_max_ = lattice.value_max;
  scale_ = {value_min_, value_max_};
  RequireSize(size_);
  voxels_ = NewTexture(GL_R32F, size_ + Vec3i::Constant(2));
  ranges_ = NewTexture(GL_RG32F, cell_brick_count_);
  if (voxels_ == 0 || ranges_ == 0) {
    Release();
    throw Error(ErrorKind::kTooLarge,
                "the graphics card has no memory left for the volume of " + SizeText(size_) +
                    ": close other programs that use it, or load a resampled or cropped volume");
  }
  const float background = scale_.Scaled(lattice.Background());
  Fill(voxels_, background);
  Fill(ranges_, background);
  is_waiting_.assign(lattice.Bricks(), false);
  held_ranges_.assign(volume.cell_ranges().size(), {background, background});
}

void VolumeTexture::UploadBrick(const Brick& brick, std::uint64_t number) {
  const Vec3i first = BrickWithNumber(number, BrickCounts(size_)) * kBrickEdge;
  const Vec3i extent = (size_ - first).cwiseMin(kBrickEdge);
  Brick texels;
  std::transform(brick.begin(), brick.end(), texels.begin(),
                 [this](float value) { return scale_.Scaled(value); });
  glBindTexture(GL_TEXTURE_3D, voxels_);
  glPixelStorei(GL_UNPACK_ROW_LENGTH, kBrickEdge);
  glPixelStorei(GL_UNPACK_IMAGE_HEIGHT, kBrickEdge);
  glTexSubImage3D(GL_TEXTURE_3D, 0, first.z() + 1, first.y() + 1, first.x() + 1, extent.z(),
                  extent.y(), extent.x(), GL_RED, GL_FLOAT, texels.data());
  ++version_;
  glPixelStorei(GL_UNPACK_ROW_LENGTH, 0);
  glPixelStorei(GL_UNPACK_IMAGE_HEIGHT, 0);
}

// While some corner values wait, the values on the card are within the old range, and new values
// are within the range of the volume. So the range must hold both.
void VolumeTexture::WidenRangesAt(std::uint64_t number, const ViewVolume& volume) {
  const Vec3i brick = BrickWithNumber(number, BrickCounts(size_));
  for (int n = 0; n < 8; ++n) {
    const Vec3i cell_brick = brick + Vec3i(n >> 2, n >> 1 & 1, n & 1);
    if ((cell_brick.array() >= cell_brick_count_.array()).any()) continue;
    const std::uint64_t at = BrickNumber(cell_brick, cell_brick_count_);
    ValueRange& held = held_ranges_[at];
    const ValueRange& values = volume.cell_ranges()[at];
    ValueRange range{scale_.Scaled(values.min), scale_.Scaled(values.max)};
    if (IsWaitingAt(cell_brick)) {
      range = {std::min(range.min, held.min), std::max(range.max, held.max)};
    }
    if (range.min == held.min && range.max == held.max) continue;
    held = range;
    changed_ranges_.push_back(at);
  }
}

bool VolumeTexture::IsWaitingAt(const Vec3i& cell_brick) const {
  const Vec3i counts = BrickCounts(size_);
  for (int n = 0; n < 8; ++n) {
    const Vec3i brick = cell_brick - Vec3i(n >> 2, n >> 1 & 1, n & 1);
    if ((brick.array() < 0).any() || (brick.array() >= counts.array()).any()) continue;
    if (is_waiting_[BrickNumber(brick, counts)]) return true;
  }
  return false;
}

// Uploads whole rows: one range costs about as much as a row.
void VolumeTexture::UploadRanges() {
  std::sort(changed_ranges_.begin(), changed_ranges_.end());
  glBindTexture(GL_TEXTURE_3D, ranges_);
  for (auto first = changed_ranges_.begin(); first != changed_ranges_.end();) {
    const Vec3i at = BrickWithNumber(*first, cell_brick_count_);
    const std::uint64_t row_end = *first + cell_brick_count_.z() - at.z();
    const auto beyond = std::lower_bound(first, changed_ranges_.end(), row_end);
    const auto length = static_cast<GLsizei>(*std::prev(beyond) - *first + 1);
    glTexSubImage3D(GL_TEXTURE_3D, 0, at.z(), at.y(), at.x(), length, 1, 1, GL_RG, GL_FLOAT,
                    &held_ranges_[*first]);
    first = beyond;
  }
  changed_ranges_.clear();
}

}  // namespace palpate::view
