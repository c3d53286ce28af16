// What the pointer points at in the volume: strokes of the brush, and where it leads the hand.
#pragma once

#include <algorithm>
#include <cstdint>
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

// A stroke of the brush with the pointer. It follows the surface as it was when the button was
// pressed. The stroke's own edits move the surface. If the stroke followed the moved surface, a
// pointer at rest would bore through the volume, and a slow one would dig ever deeper.
//
// Pixels of the view from its upper left corner. Frame: D (mm).
// Threads: that of the frames.
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

enum class HandWay {
  kSurface,  // along the surface that is seen
  kPlane,    // in the plane across the line of sight
};

struct HandOptions {
  HandWay way = HandWay::kSurface;
  // How far behind the surface the hand wants to be, along the sight: the tip's own surface, if it
  // is a ball. The hand is a spring, so this is how firmly it touches. Negative: before the
  // surface.
  double press_mm = 3.0;
  // Kept on, as if they were held: bit n is the stylus's button n; the pointer turns the stylus.
  std::uint32_t kept_buttons = 0;
  bool turns = false;
  static constexpr double kLeastPress_mm = -20.0;
  static constexpr double kMostPress_mm = 20.0;

  void Press(double more_mm) {
    press_mm = std::clamp(press_mm + more_mm, kLeastPress_mm, kMostPress_mm);
  }
};

// Where the pointer leads the hand: a point under the pointer, at a depth.
//
// Pixels of the view from its upper left corner. Frame: D (mm).
// Threads: plain values.
class HandAim {
 public:
  // Where the hand is when it is taken.
  void Begin(const Vec3& hip_D) { *this = {}, plane_D_ = hip_D; }
  Vec3 target_D() const { return plane_D_ + harder_mm_ * sight_D_; }

  // Leads the target to the pointer. `tip_mm`: how far ball or tool reaches beyond the tip. Where
  // no surface is under the pointer, the hand stays in the plane of its last place.
  void Follow(const Eigen::Vector2d& at_px, const ImageSize& view, const SeenSurface& seen,
              const HandOptions& options, double tip_mm);
  // From now on, the target is this much deeper, along the last line of sight.
  void PressHarder(double harder_mm) { harder_mm_ = harder_mm; }
  // Moves the plane away from the eye.
  void Push(double farther_mm, const Camera& camera);

 private:
  Vec3 plane_D_ = Vec3::Zero();  // a point of the plane; without harder_mm_
  Vec3 sight_D_ = Vec3::Zero();  // of length 1; zero before the first Follow
  double harder_mm_ = 0.0;
};

// A ball around the volume.
struct Surroundings {
  Vec3 center_D = Vec3::Zero();
  double radius_mm = 0.0;
};

// The way of a hand to a target that is far away, perhaps on another side: a straight way would
// lead through the volume, and the proxy would stay behind. So the hand goes out of the volume,
// around it, and to the target along the line of sight, where nothing is in between. Corners in
// order; the last one is the target.
std::vector<Vec3> WayAround(const Vec3& from_D, const Vec3& target_D, const Vec3& eye_D,
                            const Surroundings& volume);

// Removes what is gone from a way, and returns where the hand is then.
Vec3 GoAlong(std::vector<Vec3>& way_D, const Vec3& from_D, double length_mm);

}  // namespace palpate::view
