// A stroke of the brush by the pointer: along the surface as it was seen when the button
// went down. The edits of the stroke move the surface; were it followed, a pointer at rest
// would bore through the volume, and a slow one dig ever deeper.
//
// Pixels of the view from its upper left corner. Frame: D (mm).
// Threads: that of the frames.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "client/view/scene/camera.h"

namespace palpate::view {

// The surface that a picture shows.
struct SeenSurface {
  ImageSize size;  // of the picture, which may have fewer pixels than the view
  Camera camera;
  std::vector<float> distances_mm;  // from the eye; infinite where there is none

  // Under a point of the view of that size; none beside the surface.
  std::optional<Vec3> At(const Eigen::Vector2d& point_px, const ImageSize& view) const;
};

class PointerStroke {
 public:
  struct Sink {
    std::function<void(const Vec3& p_D)> draw;
    std::function<void()> lift;  // what comes next is not beside what came before
  };

  // The button is held since Begin: the pointer belongs to the stroke, also where it was
  // broken off.
  bool has_pointer() const { return has_pointer_; }

  // False where no surface is under the pointer. `jump_mm`: neighbours that are so much
  // farther from the eye are another surface.
  bool Begin(SeenSurface surface, const Eigen::Vector2d& at_px, const ImageSize& view,
             double jump_mm, const Sink& sink);
  // Along a straight line, in steps of pixels.
  void MoveTo(const Eigen::Vector2d& at_px, const ImageSize& view, const Sink& sink);
  // Draws nothing more until the next Begin.
  void BreakOff() { surface_.reset(); }
  void Release();

 private:
  void Draw(const Eigen::Vector2d& at_px, const ImageSize& view, const Sink& sink);

  bool has_pointer_ = false;
  std::optional<SeenSurface> surface_;  // none: broken off
  double jump_mm_ = 0.0;
  Eigen::Vector2d at_px_ = Eigen::Vector2d::Zero();
  std::optional<Vec3> last_D_;  // none: the pointer was beside the surface
};

}  // namespace palpate::view
