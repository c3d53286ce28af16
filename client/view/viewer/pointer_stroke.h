// A stroke of the brush with the pointer. It follows the surface as it was when the button was
// pressed. The stroke's own edits move the surface. If the stroke followed the moved surface, a
// pointer at rest would bore through the volume, and a slow one would dig ever deeper.
//
// Pixels of the view from its upper left corner. Frame: D (mm).
// Threads: that of the frames.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "client/view/drawing/camera.h"

namespace palpate::view {

// The surface in a picture.
struct SeenSurface {
  ImageSize size;  // of the picture; it may have fewer pixels than the view
  Camera camera;
  std::vector<float> distances_mm;  // from the eye; infinite where there is no surface

  // Returns the surface's point under a point of the view, which has the size `view`; none beside
  // the surface.
  std::optional<Vec3> At(const Eigen::Vector2d& point_px, const ImageSize& view) const;
};

class PointerStroke {
 public:
  struct Sink {
    std::function<void(const Vec3& p_D)> draw;
    std::function<void()> lift;  // called before a point that does not continue the line
  };

  // True from Begin until the button is released, also if the stroke was broken off: the pointer
  // still belongs to the stroke.
  bool has_pointer() const { return has_pointer_; }
  // Where the stroke is now; none: beside the surface, or broken off.
  std::optional<Vec3> at_D() const { return surface_ ? last_D_ : std::nullopt; }

  // Returns false if no surface is under the pointer. `jump_mm`: a neighbour that is this much
  // farther from the eye belongs to another surface.
  bool Begin(SeenSurface surface, const Eigen::Vector2d& at_px, const ImageSize& view,
             double jump_mm, const Sink& sink);
  // Moves along a straight line, in equal steps. They are counted along the pointer's way from
  // where the button was pressed, so the points do not depend on how often the pointer is sampled.
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
  double since_step_px_ = 0.0;  // the way from the last step to at_px_
  std::optional<Vec3> last_D_;  // none: the pointer was beside the surface
};

}  // namespace palpate::view
