#include "client/view/render/surface_caster.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/shading/shading.h"
#include "client/view/render/card_memory.h"
#include "client/view/render/frame_target.h"
#include "client/view/render/gl_state.h"
#include "common/error/error.h"

namespace palpate::view {
namespace {

// The last one masks finished pixels.
enum Target { kColor, kVeilColor, kVeilDepth, kDepth, kMask, kTargets };
constexpr GLenum kFormats[kTargets] = {GL_RGBA8, GL_RGBA8, GL_R32F, GL_R32F, GL_DEPTH_COMPONENT32F};
constexpr GLenum kAttachments[kTargets] = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1,
                                           GL_COLOR_ATTACHMENT2, GL_COLOR_ATTACHMENT3,
                                           GL_DEPTH_ATTACHMENT};

// Finished pixels are near, so that an early depth test leaves them out.
constexpr char kMaskShader[] = R"(#version 430 core
layout(std430, binding = 1) buffer Unfinished { uint unfinished[]; };
uniform int image_width;

void main() {
  int pixel = int(gl_FragCoord.y) * image_width + int(gl_FragCoord.x);
  gl_FragDepth = unfinished[pixel] == 0u ? 0.0 : 1.0;
}
)";

// Without veils it is faster.
std::string SurfaceShader(std::size_t veils) {
  return "#define VEILS " + std::to_string(veils) + "\n#define MOST_LAYERS " +
         std::to_string(kMostVeilLayers) + "\n" + shading::kSurfaceDesktop +
         shading::kSurfaceInputs + shading::kRay + shading::kWalk + shading::kColors +
         shading::kLight + shading::kSurface;
}

// Returns a ray's direction in P as a linear function of (x, y, 1): pixels right and up of the
// image's centre. The direction is the difference between the point on the near plane and the eye,
// in homogeneous coordinates.
Mat3 DirectionFromPixel(const CastRequest& request, const AffineMap& X_PD) {
  const Mat4 D_from_clip = request.clip_from_D.inverse();
  Eigen::Matrix<double, 4, 3> near;
  near.col(0) = D_from_clip.col(0) * 2.0 / request.size.width;
  near.col(1) = D_from_clip.col(1) * 2.0 / request.size.height;
  near.col(2) = D_from_clip.col(3) - D_from_clip.col(2);
  const Mat3 direction_D = near.topRows<3>() - request.eye_D * near.row(3);
  const Mat3 direction_P = X_PD.linear * direction_D;
  return direction_P / direction_P.col(2).norm();
}

void SetCamera(const ShaderProgram& program, const CastRequest& request, const AffineMap& X_DP) {
  const AffineMap X_PD = X_DP.Inverse();
  Mat4 D_from_P = Mat4::Identity();
  D_from_P.topLeftCorner<3, 3>() = X_DP.linear;
  D_from_P.topRightCorner<3, 1>() = X_DP.translation;
  const Mat4 clip_from_P = request.clip_from_D * D_from_P;
  program.Set("eye", X_PD.Apply(request.eye_D));
  program.Set("image_center", Vec3(request.size.width / 2.0, request.size.height / 2.0, 0.0));
  program.Set("direction_from_pixel", DirectionFromPixel(request, X_PD));
  program.Set("clip_z", clip_from_P.row(2));
  program.Set("clip_w", clip_from_P.row(3));
  program.Set("D_from_P", X_DP.linear);
  program.Set("normal_D_from_P", X_PD.linear.transpose());
  program.Set("right_D", request.clip_from_D.row(0).head<3>().normalized());
  program.Set("up_D", request.clip_from_D.row(1).head<3>().normalized());
}

// Planes that are off cut nothing.
void SetCuts(const ShaderProgram& program, const SurfaceOptions& surface, const Vec3i& cells) {
  const auto face = [&](const Vec3& fraction) -> Vec3 {
    return fraction.cwiseMax(0.0).cwiseMin(1.0).cwiseProduct(cells.cast<double>());
  };
  program.Set("crop_min", face(surface.crop.min));
  program.Set("crop_max", face(surface.crop.max));
  const char* const names[] = {"planes[0]", "planes[1]"};
  for (std::size_t n = 0; n < surface.planes.size(); ++n) {
    const ClipPlane& plane = surface.planes[n];
    Eigen::Vector4d kept(0.0, 0.0, 0.0, 1.0);
    if (plane.on) kept << plane.normal_I, plane.offset_voxels + plane.normal_I.sum();
    program.Set(names[n], kept);
  }
}

// The layers', and the user's.
std::vector<LayerVeil> VeilsOf(const SurfaceOptions& surface) {
  std::vector<LayerVeil> veils = surface.layers;
  if (!veils.empty()) veils.pop_back();  // the surface
  if (surface.veil.shown) veils.push_back({surface.veil.isovalue, surface.veil.color});
  return veils;
}

void SetSurface(const ShaderProgram& program, const SurfaceOptions& surface,
                const BrickCache& volume) {
  const ValueScale& scale = volume.scale();
  const double range = scale.Scaled(volume.value_max()) - scale.Scaled(volume.value_min());
  const double edge_mm = std::cbrt(std::abs(volume.X_DI()->linear.determinant()));
  program.Set("surface_shown", surface.shown ? 1 : 0);
  program.Set("isovalue", scale.Split(surface.isovalue));
  program.Set("material_above", surface.free_above ? 0 : 1);
  program.Set("caps", surface.caps ? 1 : 0);
  program.Set("plain_color", surface.color);
  const std::vector<LayerVeil> veils = VeilsOf(surface);
  for (std::size_t n = 0; n < veils.size(); ++n) {
    const std::string at = "[" + std::to_string(n) + "]";
    program.Set(("veil_isovalue" + at).c_str(), scale.Split(veils[n].isovalue));
    program.Set(("veil_plain_color" + at).c_str(), veils[n].color);
  }
  program.Set("veil_opacity", surface.veil.opacity);
  program.Set("coloring", static_cast<int>(surface.coloring));
  program.Set("steepest", range > 0.0 ? 0.5 * range / edge_mm : 1.0);
  program.Set("window_min", scale.Split(surface.window_min));
  program.Set("window_range", scale.Scaled(surface.window_max) - scale.Scaled(surface.window_min));
}

}  // namespace

// A picture, as it is cast.
struct SurfaceCaster::Casting {
  Casting() { glGenFramebuffers(1, &framebuffer); }
  ~Casting() {
    glDeleteTextures(kTargets, targets);
    glDeleteFramebuffers(1, &framebuffer);
  }
  Casting(const Casting&) = delete;
  Casting& operator=(const Casting&) = delete;

  void Resize(const ImageSize& size);
  void BindTarget(const ImageSize& size) const;
  void Clear() const;
  // The picture is one of this request, with this content of the volume.
  bool IsOf(const BrickCache& of, const CastRequest& what) const {
    return request == what && volume == &of && content_version == of.content_version();
  }
  // More bricks would not change it, or none have come.
  bool IsWhole(const BrickCache& of) const {
    return next_row == request->size.height && (missing == 0 || version == of.version());
  }

  GLuint framebuffer = 0;
  GLuint targets[kTargets] = {};
  CardBuffer unfinished{GL_R32UI, sizeof(std::uint32_t)};  // by pixel

  // The request that the textures show.
  std::optional<CastRequest> request;
  const BrickCache* volume = nullptr;
  std::uint64_t version = 0;
  std::uint64_t content_version = 0;
  std::size_t missing = 0;  // bricks that the textures want
  int next_row = 0;         // from below; the height: all rows are cast
};

void SurfaceCaster::Casting::Resize(const ImageSize& size) {
  if (request && request->size == size) return;
  RequirePictureSize(size);
  request.reset();
  const bool has_room = unfinished.Reserve(static_cast<std::size_t>(size.width) * size.height);
  glDeleteTextures(kTargets, targets);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  for (int n = 0; n < kTargets; ++n) {
    targets[n] = NewTexture(kFormats[n], size);
    glFramebufferTexture2D(GL_FRAMEBUFFER, kAttachments[n], GL_TEXTURE_2D, targets[n], 0);
  }
  glDrawBuffers(4, kAttachments);
  if (!has_room || glCheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE) {
    throw Error(ErrorKind::kInternal, "the graphics driver refuses a framebuffer of " +
                                          std::to_string(size.width) + " x " +
                                          std::to_string(size.height) + " pixels");
  }
}

void SurfaceCaster::Casting::BindTarget(const ImageSize& size) const {
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  glViewport(0, 0, size.width, size.height);
  ResetState();
}

void SurfaceCaster::Casting::Clear() const {
  const GLfloat none[] = {0.0f, 0.0f, 0.0f, 0.0f};
  const GLfloat farthest[] = {1.0f, 1.0f, 1.0f, 1.0f};
  glClearBufferfv(GL_COLOR, kColor, none);
  glClearBufferfv(GL_COLOR, kVeilColor, none);
  glClearBufferfv(GL_COLOR, kVeilDepth, farthest);
  glClearBufferfv(GL_COLOR, kDepth, farthest);
  glClearBufferfv(GL_DEPTH, 0, farthest);
}

void SurfaceCaster::MaskFinished(const Casting& picture) const {
  glMemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
  glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_ALWAYS);
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kFirstFreeBuffer, picture.unfinished.buffer());
  mask_program_.Use();
  mask_program_.Set("image_width", picture.request->size.width);
  mask_program_.Draw();
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
}

void SurfaceCaster::Draw(const Casting& picture, const BrickCache& cache, const CastRequest& what) {
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_LESS);
  glDepthMask(GL_FALSE);
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kFirstFreeBuffer, picture.unfinished.buffer());
  const std::size_t veils = VeilsOf(what.surface).size();
  VolumePrograms& programs = programs_.try_emplace(veils, SurfaceShader(veils)).first->second;
  const ShaderProgram& program = programs.Use(cache, what.surface.color_map);
  program.Set("image_width", what.size.width);
  // Frame P of shading.h.
  SetCamera(program, what, *cache.X_DI() * AffineMap{.translation = -Vec3::Ones()});
  SetCuts(program, what.surface, cache.size() + Vec3i::Ones());
  SetSurface(program, what.surface, cache);
  program.Draw();
  glDepthMask(GL_TRUE);
}

// Casts the rows from the next one to before `end_row`.
void SurfaceCaster::CastTo(Casting& picture, BrickCache& volume, const CastRequest& request,
                           int end_row, BrickCache::Marks marks) {
  if (volume.has_volume() && volume.X_DI()) {
    volume.BeginPicture();
    glEnable(GL_SCISSOR_TEST);
    glScissor(0, picture.next_row, request.size.width, end_row - picture.next_row);
    Draw(picture, volume, request);
    glDisable(GL_SCISSOR_TEST);
    // The rows before may have missed bricks that have come since.
    picture.missing =
        std::max(picture.missing, volume.EndPicture(BrickCache::kSurface, marks,
                                                    volume.X_DI()->Inverse().Apply(request.eye_D)));
  }
  picture.next_row = end_row;
}

SurfaceCaster::SurfaceCaster()
    : mask_program_(kMaskShader),
      shown_(std::make_unique<Casting>()),
      next_(std::make_unique<Casting>()) {}
SurfaceCaster::~SurfaceCaster() = default;

bool SurfaceCaster::Cast(BrickCache& volume, const CastRequest& request) {
  Casting& shown = *shown_;
  if (request.size.width < 1 || request.size.height < 1) return false;
  const bool same_view = shown.request == request && shown.volume == &volume;
  const bool refine = shown.IsOf(volume, request);
  if (refine && shown.IsWhole(volume)) return false;

  shown.Resize(request.size);
  shown.BindTarget(request.size);
  refine ? MaskFinished(shown) : shown.Clear();
  shown.missing = 0;
  shown.next_row = 0;
  CastTo(shown, volume, request, request.size.height,
         refine      ? BrickCache::Marks::kMore
         : same_view ? BrickCache::Marks::kAgain
                     : BrickCache::Marks::kNewView);
  shown.request = request;
  shown.volume = &volume;
  shown.version = volume.version();
  shown.content_version = volume.content_version();
  if (!refine) ++casts_;
  return true;
}

SurfaceCaster::Progress SurfaceCaster::CastRows(BrickCache& volume, const CastRequest& request,
                                                int rows) {
  if (request.size.width < 1 || request.size.height < 1) return Progress::kWhole;
  if (shown_->IsOf(volume, request) && shown_->IsWhole(volume)) return Progress::kWhole;
  Casting& next = *next_;
  const bool begins = !next.IsOf(volume, request);
  if (!begins && next.next_row == request.size.height) {
    // First all bricks that it wants, then the pixels that wait for them.
    if (!volume.is_settled()) return Progress::kWaits;
    if (next.version == volume.version()) return ShowNext();
  }
  if (begins) next.Resize(request.size);
  next.BindTarget(request.size);
  if (begins) {
    next.Clear();
    next.request = request;
    next.volume = &volume;
    next.content_version = volume.content_version();
  } else if (next.next_row == request.size.height) {
    MaskFinished(next);
  }
  if (begins || next.next_row == request.size.height) {
    next.missing = 0;
    next.next_row = 0;
    next.version = volume.version();
  }
  // What the shown picture wants is wanted still.
  CastTo(next, volume, request, std::min(next.next_row + std::max(rows, 1), request.size.height),
         BrickCache::Marks::kMore);
  if (next.next_row < request.size.height) return Progress::kMore;
  return next.missing > 0 ? Progress::kWaits : ShowNext();
}

SurfaceCaster::Progress SurfaceCaster::ShowNext() {
  std::swap(shown_, next_);
  ++casts_;
  return Progress::kWhole;
}

unsigned SurfaceCaster::color() const { return shown_->targets[kColor]; }
unsigned SurfaceCaster::depth() const { return shown_->targets[kDepth]; }
unsigned SurfaceCaster::veil_color() const { return shown_->targets[kVeilColor]; }
unsigned SurfaceCaster::veil_depth() const { return shown_->targets[kVeilDepth]; }

}  // namespace palpate::view
